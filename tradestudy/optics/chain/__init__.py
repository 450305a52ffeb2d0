"""Light through main lens and microlens array onto the pixels, by rays and by waves, with error estimates."""
