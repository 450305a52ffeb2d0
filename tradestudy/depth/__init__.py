"""The distribution of one camera's depth, over distance: what every answer about depth is read from."""
