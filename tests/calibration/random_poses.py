"""Boards held by hand: poses at random, as no plan spreads them."""

import numpy as np


def tilted_poses(count, distances, half_field, tilt, rng):
    """Poses (count, 6): distances even in 1/Z, slopes of the middle uniform, components of the rotation normal."""
    depth = 1.0 / np.linspace(1.0 / distances[0], 1.0 / distances[1], count)
    slopes = rng.uniform(-half_field, half_field, (count, 2))
    return np.column_stack([tilt * rng.standard_normal((count, 3)), slopes * depth[:, None], depth])
