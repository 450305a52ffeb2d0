"""What is pictured: textures, surfaces, and where rays meet them."""
