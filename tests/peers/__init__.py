"""What others use, with the parameters over which each is searched."""
