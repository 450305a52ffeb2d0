"""What a picture of a spot costs, from counts of the work that its light path and tolerance call for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from tradestudy.effects.light_scene import LightScene
from tradestudy.optics.chain import ChainAccuracy, LightPath
from tradestudy.optics.chain.detector_patch import (
    SINGLE_PRECISION_FROM,
    DetectorPatch,
    detector_patch,
    disc_ends,
    lit_radius,
)
from tradestudy.optics.chain.exact_rays import SHIFTS, ray_count, start_of_rays
from tradestudy.optics.chain.rays import ray_reach
from tradestudy.optics.chain.scene import Legs
from tradestudy.optics.chain.separate_lenses import microlens_alone, nearest_microlens
from tradestudy.optics.chain.source_tables import table_count
from tradestudy.optics.chain.sources import SourceNodes, source_nodes, symmetries
from tradestudy.optics.chain.spot_image import source_density
from tradestudy.optics.chain.traced_forwards import reached_microlenses
from tradestudy.optics.chain.whole_detector import plan_detector
from tradestudy.optics.propagation.hybrid import LEAST_ZONES

# Processor seconds per unit of work on the reference machine; `python -m tests.campaigns.light_seconds` measures them.
SECONDS: Final[Mapping[str, float]] = {
    "rays of a disc: pixel behind a microlens": 2.3e-5,
    "rays of a point: pixel behind a microlens": 2e-6,
    "exact ray from the detector": 6e-8,
    "exact ray from the array": 2.0e-7,
    "exact ray from the source": 2.0e-7,
    "exact ray from the source past a microlens": 1e-8,
    "first exact ray past a microlens": 1e-4,
    "sample of a patch": 4.0e-8,
    "sample of a patch in double precision": 6.0e-8,
    "sample of a patch, boundary wave": 1.0e-7,
    "sample of a patch, boundary wave in focus": 5e-9,
    "sample of the detector": 3.0e-7,
    "microlens field, Kirchhoff": 0.6,
    "microlens field, Fresnel": 0.1,
    "microlens field, boundary wave": 0.3,
    "microlens field, boundary wave to a thousandth": 3.0,
}
_FINE_BOUNDARY_WAVE: Final = 5e-3  # tolerance below which its edge takes many nodes


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

    @cached_property
    def patch(self) -> DetectorPatch:
        """Where light of a disc is followed behind the array."""
        path, source = self.scene.path, self.scene.source
        return detector_patch(
            path,
            source,
            disc_ends(path, source, self._nodes),
            wavelength=self.scene.wavelength,
            paraxial=False,
            accuracy=self._accuracy,
        )

    @cached_property
    def detector_side(self) -> int:
        """Samples along a side of the grid for all microlenses and pixels at once, as a single point is computed."""
        path, wavelength = self.scene.path, self.scene.wavelength
        reach = ray_reach(path, self.scene.source.centre)
        plan = plan_detector(path, [reach], wavelength=wavelength, paraxial=False, accuracy=self._accuracy)
        return plan.transfer.count

    @property
    def _accuracy(self) -> ChainAccuracy:
        return ChainAccuracy(tolerance=self.tolerance)

    @cached_property
    def _nodes(self) -> SourceNodes:
        scene = self.scene
        density = source_density(self._accuracy)
        return source_nodes(scene.path, scene.source, wavelength=scene.wavelength, density=density)

    @cached_property
    def source_points(self) -> float:
        """Points of the disc, without those that its symmetries give."""
        return len(self._nodes.all) / len(symmetries(self.scene.path, self.scene.source))

    @cached_property
    def lit_microlenses(self) -> float:
        """Microlenses that light of one point of the disc reaches, on average over the disc."""
        scene, lenses = self.scene, self.scene.path.microlenses
        within = lit_radius(scene.path, scene.source.centre, scene.wavelength, self._accuracy)
        moved = scene.source.diameter / 2.0 * scene.path.array_distance / scene.source.distance
        chief = np.asarray(scene.path.chief_point(scene.source.centre))
        angle = math.pi / 4.0 * np.arange(8)
        at = chief + np.concatenate([[[0.0, 0.0]], 0.7 * moved * np.column_stack([np.cos(angle), np.sin(angle)])])
        seen = np.linalg.norm(lenses.centres - at[:, None], axis=-1) <= within
        return float(np.mean(np.maximum(seen.sum(axis=1), 1)))

    def seconds_of_disc(self, *, laws: Legs, separate: bool) -> float:
        """A picture of the whole disc; of every microlens alone, each as dear as the first, if separate."""
        if separate:
            return self.scene.path.microlenses.count * self._alone.seconds_of_disc(laws=laws, separate=False)
        points, lit = self.source_points, self.lit_microlenses
        unit = "sample of a patch" + (" in double precision" if self.tolerance < SINGLE_PRECISION_FROM else "")
        return (
            SECONDS[unit] * points * self.patch.work(self.scene.path, lit=lit)
            + points * self._seconds_of_edges(laws, lit=lit)
            + self._seconds_of_field(laws) * table_count(self._accuracy)
            + self.seconds_of_point(laws=laws)
        )

    @cached_property
    def _alone(self) -> LightWork:
        """The work of the first microlens with its own pixels."""
        path = self.scene.path
        owner = nearest_microlens(path)
        alone = microlens_alone(path, int(owner.min()), owner)
        return replace(self, scene=replace(self.scene, path=alone))

    def seconds_of_exact_rays(self, *, point: bool) -> float:
        """A picture by rays of exact directions, computed twice to state its error, and not refined after that."""
        source = self.scene.source.centre if point else self.scene.source
        path = self.scene.path
        start, rays = start_of_rays(path, source), ray_count(path, source, self._accuracy)
        seconds = SECONDS[f"exact ray from the {start}"] * rays
        if start == "source":
            past = SECONDS["exact ray from the source past a microlens"] * rays
            # Some rays tell first how many are needed.
            past += SECONDS["first exact ray past a microlens"] * 2 * SHIFTS
            seconds += past * reached_microlenses(path, source)
        return seconds

    def seconds_of_point(self, *, laws: Legs) -> float:
        """A picture of a single point, computed twice to state its error."""
        behind = self._seconds_of_edges(laws, lit=self.lit_microlenses)
        return SECONDS["sample of the detector"] * self.detector_side**2 + self._seconds_of_field(laws) + behind

    def _seconds_of_field(self, laws: Legs) -> float:
        if laws.to_array == "boundary_wave":
            fine = self.tolerance < _FINE_BOUNDARY_WAVE
            return SECONDS["microlens field, boundary wave" + (" to a thousandth" if fine else "")]
        # Rays need no table, about as good as nothing to Fresnel's.
        return SECONDS["microlens field, Kirchhoff" if laws.to_array == "kirchhoff" else "microlens field, Fresnel"]

    def _seconds_of_edges(self, laws: Legs, *, lit: float) -> float:
        """What a boundary wave behind the array adds to a source point; in focus it finds that it has none to add."""
        if laws.to_detector != "boundary_wave":
            return 0.0
        in_focus = self.scene.largest_microlens_fresnel_number < LEAST_ZONES
        unit = "sample of a patch, boundary wave" + (" in focus" if in_focus else "")
        return SECONDS[unit] * lit * self.patch.side**2


def seconds_of_rays(path: LightPath, *, point: bool) -> float:
    """A picture by rays."""
    what = "rays of a point" if point else "rays of a disc"
    pixels = path.pixels.shape[0] * path.pixels.shape[1]
    return SECONDS[f"{what}: pixel behind a microlens"] * pixels * path.microlenses.count
