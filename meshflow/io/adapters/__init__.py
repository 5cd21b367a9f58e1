"""Adapters for objects of other libraries, one library per file."""
