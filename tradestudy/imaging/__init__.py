"""What a picture leaves of a texture at every distance: transfer, noise and light, and how well it is matched."""
