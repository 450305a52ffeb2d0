"""Render pictures of scenes: nodes on pixels and lenses, what their rays meet, and how the sensor records it."""
