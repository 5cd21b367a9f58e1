"""What is there: surfaces, cameras, the operator. No time, no files."""
