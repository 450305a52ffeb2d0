"""What the picture of a coherent disc costs beside that of a point: its wave on every node of the pupil."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from tradestudy.effects.light_scene import LightScene

# Processor seconds per node of the pupil on the reference machine, the picture that states the error and the checks
# included; `python -m tests.campaigns.light_seconds` measures them.
SECONDS_PER_NODE: Final[Mapping[str, float]] = {"fresnel": 6e-6, "kirchhoff": 1.3e-4}
_NODES: Final = 0.36  # per square of the largest phase over the pupil [1/rad²]


def seconds_of_coherent_wave(scene: LightScene, *, paraxial: bool) -> float:
    """Seconds that the wave of the disc takes on the pupil, for every wavelength.

    Nodes resolve the phase k R s/z to the farthest point s of the array, which every point of the disc moves by its
    own slope; Kirchhoff's law interpolates between distances, Fresnel's is one transform.
    """
    return SECONDS_PER_NODE["fresnel" if paraxial else "kirchhoff"] * pupil_nodes(scene)


def pupil_nodes(scene: LightScene) -> float:
    """Nodes of the main pupil that a coherent disc takes, about."""
    path, source = scene.path, scene.source
    z, chief = path.array_distance, np.asarray(path.chief_point(source.centre))
    farthest = np.linalg.norm(path.microlenses.centres - chief, axis=1).max() + path.microlenses.cell_reach
    slope = (farthest + z * source.diameter / 2.0 / source.distance) / z
    return _NODES * float(2.0 * math.pi / scene.wavelength * path.main_lens.radius * slope) ** 2
