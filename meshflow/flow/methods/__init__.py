"""The methods, one in a file: each with its equation and its own options."""
