"""Depth maps from pictures, and how they compare with the truth."""
