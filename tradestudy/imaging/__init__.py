"""Scenes with depth to raw images, and back."""
