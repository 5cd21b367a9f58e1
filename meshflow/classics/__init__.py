"""The systems that the paper cites, each with its equation."""
