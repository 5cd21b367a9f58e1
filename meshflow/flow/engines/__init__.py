"""Engines: the same rate on explicit triangles and on the samples of a grid."""
