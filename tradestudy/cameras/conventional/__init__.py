"""A conventional camera, with a fixed focus or a focus stack."""
