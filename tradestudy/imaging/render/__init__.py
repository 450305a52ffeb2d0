"""Pictures of scenes by rays: nodes on pixels and lenses, what they see, and what the sensor makes of it."""
