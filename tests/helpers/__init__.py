"""What several test files need: shapes, small files, cameras. No test file imports another."""
