"""Data with a known answer: terrains, meshes, and simulated sensors."""
