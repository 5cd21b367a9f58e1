"""The edge: files and other people's objects. What comes in becomes a data object; a data object goes out as what came in."""
