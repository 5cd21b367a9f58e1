"""Larger than memory: a grid is run by windows that together equal the whole bit for bit."""
