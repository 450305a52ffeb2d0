"""What a picture preserves of a texture at every distance: transfer, noise, light, and the matching error."""
