"""Depth maps from pictures, and their comparison with the truth."""
