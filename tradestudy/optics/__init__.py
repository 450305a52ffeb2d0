"""The physics as functions on arrays; it knows no camera."""
