"""What was done, and why."""
