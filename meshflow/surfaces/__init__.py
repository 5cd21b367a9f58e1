"""What there is: height fields, images, range images, meshes, and the cameras that see them."""
