"""The edge: files and other people's objects. What comes in becomes a noun; a noun goes out as what came in."""
