"""Objects of other libraries, one library in a file."""
