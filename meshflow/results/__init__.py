"""Results: what a run did, and why."""
