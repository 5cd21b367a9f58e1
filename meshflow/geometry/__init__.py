"""Geometry of triangles: functions that take arrays and return arrays."""
