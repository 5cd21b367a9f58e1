"""How it moves: knows u and its rate, not where u came from."""
