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
from tradestudy.optics.chain.array_field import PupilWave
from tradestudy.optics.chain.arriving_light import field_spacing
from tradestudy.optics.chain.detector_patch import (
    SINGLE_PRECISION_FROM,
    DetectorPatch,
    detector_patch,
    disc_ends,
    lit_radius,
)
from tradestudy.optics.chain.exact_rays import SHIFTS, ray_count, start_of_rays
from tradestudy.optics.chain.image import microlens_alone, nearest_microlens
from tradestudy.optics.chain.point_image import count_point
from tradestudy.optics.chain.sampled_rays import reached_microlenses
from tradestudy.optics.chain.scene import Legs
from tradestudy.optics.chain.source_tables import farthest_read, table_count
from tradestudy.optics.chain.sources import SourceNodes, source_nodes
from tradestudy.optics.chain.spot_image import source_density
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
    "sample of a patch": 3.9e-8,
    "sample of a patch in double precision": 6.5e-8,
    "sample of a patch, boundary wave": 2.0e-7,
    "sample of a patch, boundary wave in focus": 5e-9,
    "node behind all microlenses": 5e-7,
    "sample of the detector": 1.0e-7,
    "node behind all microlenses, by quadrature": 1.3e-6,
    "sample of the detector, by quadrature": 2.0e-7,
    "sample of the field of a point, Kirchhoff": 1.3e-6,
    "sample of the field of a point, Fresnel": 1e-7,
    "sample of a table, Kirchhoff": 3.5e-6,
    "sample of a table, Fresnel": 3e-7,
    "microlens field, boundary wave": 0.3,
    "microlens field, boundary wave to a thousandth": 3.0,
}
# Processor seconds per node of the pupil on the reference machine, the picture that states the error and the checks
# included; `python -m tests.campaigns.light_seconds` measures them.
SECONDS_PER_NODE: Final[Mapping[str, float]] = {"fresnel": 6e-6, "kirchhoff": 1.3e-4}
_NODES: Final = 0.36  # per square of the largest phase over the pupil [1/rad²]
_CHECKED = 2  # points of a disc that are computed anew by finer settings
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
        """Points of the disc, without those that its symmetries give, and points between them that tell the error."""
        rings, order = self._nodes.rings, self.scene.symmetry_order
        return (sum(map(len, rings)) + 2 * max(map(len, rings))) / order + 2 * len(rings) + 1

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
            + self._seconds_of_tables(laws)
            + _CHECKED * self._check.seconds_of_pass(laws)
        )

    @cached_property
    def _point(self) -> PointWork:
        return PointWork(scene=self.scene, accuracy=self._accuracy)

    @cached_property
    def _check(self) -> PointWork:
        return PointWork(scene=self.scene, accuracy=self._accuracy.unstarved())

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
        """A picture of a single point, computed twice and held against direct quadrature to state its error."""
        behind = self._seconds_of_edges(laws, lit=self.lit_microlenses)
        return 2 * self._point.seconds_of_pass(laws) + self._point.seconds_of_quadrature() + behind

    def _seconds_of_tables(self, laws: Legs) -> float:
        path, source, accuracy = self.scene.path, self.scene.source, self._accuracy
        if laws.to_array == "geometric":
            return 0.0
        if laws.to_array == "boundary_wave":
            return _boundary_wave_field(self.tolerance) * table_count(accuracy)
        half = farthest_read(path, source, float(np.linalg.norm(self._nodes.all, axis=1).max()))
        if not self.patch.whole_detector:
            half = min(half, lit_radius(path, source.centre, self.scene.wavelength, accuracy))
        samples = (2 * half / field_spacing(_wave(self.scene), accuracy)) ** 2
        return SECONDS[f"sample of a table, {_title(laws)}"] * samples * table_count(accuracy)

    def _seconds_of_edges(self, laws: Legs, *, lit: float) -> float:
        """What a boundary wave behind the array adds to a source point; in focus it finds that it has none to add."""
        if laws.to_detector != "boundary_wave":
            return 0.0
        in_focus = self.scene.largest_microlens_fresnel_number < LEAST_ZONES
        unit = "sample of a patch, boundary wave" + (" in focus" if in_focus else "")
        return SECONDS[unit] * lit * self.patch.side**2


@dataclass(frozen=True, kw_only=True)
class PointWork:
    """Counts of the work of one pass over a single point, all microlenses at once."""

    scene: LightScene
    accuracy: ChainAccuracy

    def seconds_of_pass(self, laws: Legs) -> float:
        """Field on the array, nodes behind it, samples of the detector."""
        field = 0.0
        if laws.to_array == "boundary_wave":
            field = _boundary_wave_field(self.accuracy.tolerance)
        elif laws.to_array != "geometric":
            field = SECONDS[f"sample of the field of a point, {_title(laws)}"] * self.field_samples
        nodes, samples = self.nodes_and_samples
        return field + SECONDS["node behind all microlenses"] * nodes + SECONDS["sample of the detector"] * samples

    def seconds_of_quadrature(self) -> float:
        """Holding a pass against direct quadrature."""
        nodes, samples = self.nodes_and_samples
        return (
            SECONDS["node behind all microlenses, by quadrature"] * nodes
            + SECONDS["sample of the detector, by quadrature"] * samples
        )

    @cached_property
    def nodes_and_samples(self) -> tuple[int, int]:
        """Behind all microlenses, and on the grid that holds the detector."""
        return count_point(_wave(self.scene), "kirchhoff", self.accuracy)

    @cached_property
    def field_samples(self) -> float:
        """Of the main lens's field over the array."""
        lenses = self.scene.path.microlenses
        width = np.ptp(lenses.centres, axis=0) + 2 * lenses.cell_reach
        return float(np.prod(width / field_spacing(_wave(self.scene), self.accuracy)))


def _wave(scene: LightScene) -> PupilWave:
    return PupilWave(path=scene.path, source=scene.source.centre, wavelength=scene.wavelength, method="kirchhoff")


def _boundary_wave_field(tolerance: float) -> float:
    return SECONDS["microlens field, boundary wave" + (" to a thousandth" if tolerance < _FINE_BOUNDARY_WAVE else "")]


def _title(laws: Legs) -> str:
    return "Kirchhoff" if laws.to_array == "kirchhoff" else "Fresnel"


def seconds_of_rays(path: LightPath, *, point: bool) -> float:
    """A picture by rays."""
    what = "rays of a point" if point else "rays of a disc"
    pixels = path.pixels.shape[0] * path.pixels.shape[1]
    return SECONDS[f"{what}: pixel behind a microlens"] * pixels * path.microlenses.count


def pupil_nodes(scene: LightScene) -> float:
    """Nodes of the main pupil that the wave of a coherent disc takes, about, for every wavelength.

    They resolve the phase k R s/z to the farthest point s of the array, which every point of the disc moves by its own
    slope; Kirchhoff's law interpolates between distances, Fresnel's is one transform.
    """
    path, source = scene.path, scene.source
    z, chief = path.array_distance, np.asarray(path.chief_point(source.centre))
    farthest = np.linalg.norm(path.microlenses.centres - chief, axis=1).max() + path.microlenses.cell_reach
    slope = (farthest + z * source.diameter / 2.0 / source.distance) / z
    return _NODES * float(2.0 * math.pi / scene.wavelength * path.main_lens.radius * slope) ** 2
