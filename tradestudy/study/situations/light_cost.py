"""What a picture of a spot costs, from counts of the work that its light path and tolerance call for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from tradestudy.effects.light_scene import LightScene
from tradestudy.optics.chain import ChainAccuracy, LightPath
from tradestudy.optics.chain.sources import source_nodes, symmetries
from tradestudy.optics.chain.spot_image import source_density

# Processor seconds per unit of work on the reference machine; `python -m tests.campaigns.light_seconds` measures them.
SECONDS: Final[Mapping[str, float]] = {
    "rays of a disc: pixel behind a microlens": 2.3e-5,
    "rays of a point: pixel behind a microlens": 2e-6,
    "sample of a patch": 4.5e-8,
    "sample of a patch in double precision": 1.2e-7,
    "sample of the detector": 3.0e-7,
    "microlens field, Kirchhoff": 0.6,
    "microlens field, Fresnel": 0.1,
}
_FADING = 4.0  # Fresnel lengths beyond what is kept of the light
_FIELDS = 4.0  # of the main lens that a disc needs at a tolerance of 1 %
_DOUBLE_BELOW = 1e-3


@dataclass(frozen=True, kw_only=True)
class LightWork:
    """Counts of the work of one picture by waves.

    Parameters
    ----------
    scene
        Light path, disc and wavelength.
    tolerance
        Of the numerical integrals.
    """

    scene: LightScene
    tolerance: float

    @property
    def _growth(self) -> float:
        """Fresnel lengths up to which diffracted light is followed."""
        return 1.2 * math.pow(self.tolerance, -1.0 / 6.0)

    @cached_property
    def patch_side(self) -> float:
        """Samples along a side of the periodic grid behind one microlens."""
        return self._side(self.scene.path.microlenses.cell_reach, self._beyond)

    @cached_property
    def detector_side(self) -> float:
        """The same for all microlenses and pixels at once, as a single point is computed."""
        path = self.scene.path
        array = float(np.max(np.abs(path.microlenses.centres))) + path.microlenses.cell_reach
        return self._side(array, max(path.pixels.shape) * path.pixels.pitch / 2.0)

    @property
    def _beyond(self) -> float:
        """How far light lands from its ray image [m]."""
        scene = self.scene
        return scene.blur_on_detector + self._growth * math.sqrt(scene.wavelength * scene.path.detector_distance)

    def _side(self, nodes: float, targets: float) -> float:
        scene, b = self.scene, self.scene.path.detector_distance
        faded = scene.path.microlenses.cell_reach + self._beyond + _FADING * math.sqrt(scene.wavelength * b)
        band = faded / math.hypot(faded, b) / scene.wavelength
        per_pixel = max(3, math.ceil(2.0 * band * scene.path.pixels.pitch))
        return (nodes + targets + faded) * per_pixel / scene.path.pixels.pitch

    @cached_property
    def source_points(self) -> float:
        """Points of the disc, without those that its symmetries give."""
        scene = self.scene
        density = source_density(ChainAccuracy(tolerance=self.tolerance))
        nodes = source_nodes(scene.path, scene.source, wavelength=scene.wavelength, density=density)
        return len(nodes.all) / len(symmetries(scene.path, scene.source))

    @cached_property
    def lit_microlenses(self) -> float:
        """Microlenses that light of one point of the disc reaches, on average over the disc."""
        scene, lenses = self.scene, self.scene.path.microlenses
        reach = math.sqrt(scene.wavelength * max(abs(scene.depth), scene.path.detector_distance))
        within = scene.blur_on_array + self._growth * reach + lenses.cell_reach
        moved = scene.source.diameter / 2.0 * scene.path.array_distance / scene.source.distance
        chief = np.asarray(scene.path.chief_point(scene.source.centre))
        angle = math.pi / 4.0 * np.arange(8)
        at = chief + np.concatenate([[[0.0, 0.0]], 0.7 * moved * np.column_stack([np.cos(angle), np.sin(angle)])])
        seen = np.linalg.norm(lenses.centres - at[:, None], axis=-1) <= within
        return float(np.mean(np.maximum(seen.sum(axis=1), 1)))

    def seconds_of_disc(self, *, paraxial: bool, separate: bool) -> float:
        """A picture of the whole disc; of every microlens alone, without the symmetry of the array, if separate."""
        points, lit = self.source_points, self.lit_microlenses
        repeats = 1.0
        if separate:
            repeats = float(self.scene.path.microlenses.count)
            points, lit = points * len(symmetries(self.scene.path, self.scene.source)), 1.0
        unit = "sample of a patch" + (" in double precision" if self.tolerance < _DOUBLE_BELOW else "")
        fields = _FIELDS * math.pow(1e-2 / self.tolerance, 1.0 / 6.0)
        samples = points * lit * self.patch_side**2
        return repeats * (
            SECONDS[unit] * samples + SECONDS[_field(paraxial)] * fields + self.seconds_of_point(paraxial=paraxial)
        )

    def seconds_of_point(self, *, paraxial: bool) -> float:
        """A picture of a single point, computed twice to state its error."""
        return SECONDS["sample of the detector"] * self.detector_side**2 + SECONDS[_field(paraxial)]


def seconds_of_rays(path: LightPath, *, point: bool) -> float:
    """A picture by rays."""
    what = "rays of a point" if point else "rays of a disc"
    pixels = path.pixels.shape[0] * path.pixels.shape[1]
    return SECONDS[f"{what}: pixel behind a microlens"] * pixels * path.microlenses.count


def _field(paraxial: bool) -> str:
    return "microlens field, Fresnel" if paraxial else "microlens field, Kirchhoff"
