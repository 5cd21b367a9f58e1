"""File formats, one in a file."""
