"""The scene of a picture: textures, surfaces, and where rays meet them."""
