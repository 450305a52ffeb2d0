"""Trials of the picture of a light spot: how much the images of a few source points differ between two sets of models.

The image of one source point behind a few microlenses takes some hundredths of a second. Convolved with the image of
the part of the disc that lights the microlens, it represents the picture around it, so that differences that the disc
blurs away do not count.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Final, Literal

import numpy as np
import scipy.fft
import scipy.special

from tradestudy.errors import TradestudyError
from tradestudy.models.spot_images import (
    RAYS,
    SpotModels,
    legs,
    light_path,
    light_source,
    picture_of,
    refuse_large_picture,
    without_comparison,
)
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, relative_change
from tradestudy.optics.chain.arriving_light import blur_radius, point_wave, refuse_focus_on_array
from tradestudy.optics.chain.behind_microlens import nearest_microlens
from tradestudy.optics.chain.exact_rays import exact_ray_image, forward_tracer
from tradestudy.optics.chain.image import (
    microlenses_alone,
    phase_follows_source,
    refuse_change_by_phase,
    refuse_impossible,
    with_fixed_phase,
)
from tradestudy.optics.chain.point_image import compute_point
from tradestudy.optics.chain.scene import LightPath, Microlenses, PixelGrid
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.chain.spot_points import Spot, SpotRequest
from tradestudy.optics.propagation.lens import PointSource
from tradestudy.study.schema.wave_optics import LOOSEST_PICTURE, LightSpotPart

TOLERANCE: Final = 2e-3  # of the images of points
# Neighbouring points of a disc share most of their numerical error; at these settings, the rest is below `TOLERANCE` of
# the picture.
_COARSE, _SPARSE = 5e-2, 0.5
_FEWER_RAYS: Final = 3.0  # times the tolerance: of their errors, two pictures by the same rays share seven eighths
_RAYS: Final = 2**15  # per point; disc and pixels average out their errors
_AROUND: Final = 3  # points that represent a disc with its centre
_PARTS: Final = 3  # along a pixel; odd, so that one of them is at its centre
_MOST_LINES: Final = 4
_OUT: Final = 0.6  # where the probes lie between the middle of a lit part and its edge
# Pixels of a microlens and its neighbours: on one light path, three quarters of its light miss its own pixels, and
# Fresnel's law changes that light most.
_SENT_TO: Final = 9
_Seen = Literal["alone", "pair", "around"]  # the microlenses of a probe whose light is followed
_LEAST_LIT: Final = 0.05  # microlenses lit by a smaller part of the disc than this share of the largest are left out


@dataclass(frozen=True, kw_only=True)
class Probe:
    """Source points that light a microlens, and the part of the light path that forms their images.

    Attributes
    ----------
    alone
        The microlens, with its pixels and those of its neighbours, which its light may meet, divided into parts.
    pair
        The microlens and its nearest neighbour, with the pixels that belong to them, divided into parts.
    around
        The microlens and its neighbours, with their pixels, divided into parts.
    points
        Three source points around the middle of the part of the disc that lights the microlens; otherwise the source.
    coherent_radius
        Radius of a coherent disc about the point [m]; 0 for other sources.
    """

    alone: LightPath
    pair: LightPath
    around: LightPath
    points: tuple[PointSource, ...]
    coherent_radius: float


@dataclass(frozen=True, kw_only=True)
class _LitPart:
    """Part of a disc that lights a microlens: its middle, and half its widths along and across an axis [m].

    For a microlens that sees nothing of the disc, it is the whole disc, and `lit` is false.
    """

    middle: FloatArray
    axis: FloatArray
    along: float
    across: float
    lit: bool

    @property
    def size(self) -> float:
        """Its area over π, approximately [m²]; 0 if it lights nothing."""
        return self.along * self.across if self.lit else 0.0

    def at(self, along: float, across: float) -> tuple[float, float]:
        """The place at shares of half its widths."""
        x, y = self.axis
        place = self.middle + along * self.along * self.axis + across * self.across * np.array([-y, x])
        return float(place[0]), float(place[1])


def probes(part: LightSpotPart) -> tuple[Probe, ...]:
    """For every focal length, the lit microlens that sees the median share of the disc, with source points.

    For a point, and for a coherent disc, these are the nearest microlens of each focal length and the farthest lit one.
    """
    path, source = light_path(part), light_source(part)
    owner = nearest_microlens(path)
    middle = source.centre if isinstance(source, DiscSource) else source
    coherent = isinstance(source, DiscSource) and source.coherent
    radius = source.diameter / 2.0 if isinstance(source, DiscSource) else 0.0
    present = [int(index) for index in np.unique(owner)]
    if coherent or radius == 0.0:
        places = {index: [(middle.x, middle.y)] for index in _around(path, middle, present)}
    else:
        corners = [(_OUT * math.cos(turn), _OUT * math.sin(turn)) for turn in 2.0 * math.pi / 3.0 * np.arange(3)]
        lit = {index: _lit_part(path, middle, radius, index) for index in present}
        places = {index: [lit[index].at(*corner) for corner in corners] for index in _typical(path.microlenses, lit)}
    located = []
    for index, points in places.items():
        distances = np.linalg.norm(path.microlenses.centres - path.microlenses.centres[index], axis=1)
        nearest = [int(neighbour) for neighbour in np.argsort(distances, kind="stable")[:_SENT_TO]]
        around = _in_parts(microlenses_alone(path, nearest, owner))
        alone = replace(around, microlenses=path.microlenses.only(index))
        pair = _in_parts(microlenses_alone(path, nearest[:2], owner))
        located.append(
            Probe(
                alone=alone,
                pair=pair,
                around=around,
                points=tuple(PointSource(x=x, y=y, distance=middle.distance) for x, y in points),
                coherent_radius=radius if coherent else 0.0,
            )
        )
    return tuple(located)


def _in_parts(path: LightPath) -> LightPath:
    grid = path.pixels
    shape = (grid.shape[0] * _PARTS, grid.shape[1] * _PARTS)
    return replace(path, pixels=PixelGrid(pitch=grid.pitch / _PARTS, shape=shape, centre=grid.centre))


def _around(path: LightPath, middle: PointSource, present: Sequence[int]) -> list[int]:
    """The microlens of each focal length that is nearest to the light of a point, and the farthest lit one."""
    distance = np.linalg.norm(path.microlenses.centres - path.chief_point(middle), axis=1)
    by_distance = sorted(present, key=lambda index: float(distance[index]))
    kinds = path.microlenses.focal_lengths
    nearest = [next(index for index in by_distance if kinds[index] == kind) for kind in np.unique(kinds[present])]
    lit = [index for index in by_distance if distance[index] <= blur_radius(path, middle)]
    return list(dict.fromkeys([*nearest, *lit[-1:]]))


def _typical(microlenses: Microlenses, lit: Mapping[int, _LitPart]) -> list[int]:
    """The lit microlens of each focal length that sees the median share of a disc."""
    kinds = microlenses.focal_lengths
    typical = []
    for kind in np.unique(kinds[list(lit)]):
        size = {index: seen.size for index, seen in lit.items() if kinds[index] == kind}
        order = sorted(size, key=lambda index: -size[index])
        order = [index for index in order if size[index] >= _LEAST_LIT * size[order[0]]]
        typical.append(order[len(order) // 2])
    return typical


def _lit_part(path: LightPath, middle: PointSource, radius: float, index: int) -> _LitPart:
    """The part of a disc whose light meets a microlens: two circles overlap; the whole disc if they do not.

    The light of a source point covers a disc on the array. Seen from a microlens, the points that light it fill a
    circle about the point whose chief ray meets its centre.
    """
    magnified = middle.distance / path.array_distance
    centre = np.array([middle.x, middle.y])
    towards = -magnified * path.microlenses.centres[index] - centre
    reach = magnified * max(blur_radius(path, middle), path.microlenses.aperture_width / 2.0)
    distance = float(np.linalg.norm(towards))
    axis = towards / distance if distance > 0.0 else np.array([1.0, 0.0])
    first, last = max(-radius, distance - reach), min(radius, distance + reach)
    if first >= last:
        return _LitPart(middle=centre, axis=axis, along=radius, across=radius, lit=False)
    place = (first + last) / 2.0
    across = math.sqrt(max(0.0, min(radius**2 - place**2, reach**2 - (place - distance) ** 2)))  # 0 where circles touch
    return _LitPart(middle=centre + place * axis, axis=axis, along=(last - first) / 2.0, across=across, lit=True)


def refuse_picture(part: LightSpotPart, models: SpotModels, tolerance_name: str) -> None:
    """Refuse a picture that a run would refuse, as far as an estimate of seconds can tell.

    Microlenses follow the source too far if fixed ones change the light of a few points, or the picture by exact rays,
    by more than the tolerance: points miss edges of the disc, rays miss diffraction, so the larger change counts. Both
    can be too small; therefore `picture_of` compares the pictures themselves.

    ``tolerance_name`` tells the reader of the refusal from where the tolerance of the models comes.

    Raises
    ------
    OutOfRangeError
        If a law does not apply to the light path, or parabolic microlenses change the picture by more than the
        tolerance of the models, by either estimate.
    UnaffordableError
        If `refuse_large_picture` raises it.
    """
    path, source, laws = light_path(part), light_source(part), legs(models.method)
    refuse_impossible(path, source, part.mean_wavelength, laws)
    if [laws.to_array, laws.to_detector].count("geometric") == 1:
        middle = source.centre if isinstance(source, DiscSource) else source
        refuse_focus_on_array(path, middle, part.mean_wavelength)
    refuse_large_picture(part, models)
    if not phase_follows_source(path, source, laws):
        return
    change = light_trial(part).change_by_fixed_phase(models)
    if not part.spot.coherent:
        change = max(change, _change_of_rays(without_comparison(part), models.tolerance, as_point=models.point))
    refuse_change_by_phase(path, change, models.tolerance, tolerance_name)


@lru_cache(maxsize=8)
def _change_of_rays(part: LightSpotPart, tolerance: float, *, as_point: bool) -> float:
    """Relative L2 change of the picture by exact rays if the phase of the microlenses is fixed."""
    path, source = light_path(part), light_source(part)
    accuracy = ChainAccuracy(tolerance=min(LOOSEST_PICTURE, _FEWER_RAYS * tolerance))
    if as_point and isinstance(source, DiscSource):
        source = source.centre
    following, fixed = (
        exact_ray_image(variant, source, accuracy=accuracy) for variant in (path, with_fixed_phase(path))
    )
    return relative_change(following.pixels, fixed.pixels)


class LightTrial:
    """Images of a few points of a spot, each computed once."""

    def __init__(self, part: LightSpotPart) -> None:
        self._part = part
        self._spots: dict[tuple[str, bool], Spot] = {}
        self._images: dict[tuple[tuple[int, int], _Seen, SpotModels, float], FloatArray] = {}

    @cached_property
    def _probes(self) -> tuple[Probe, ...]:
        return probes(self._part)

    def count(self, models: SpotModels, complete: SpotModels) -> int:
        """Number of comparisons: the points of the probes, or one where a disc counts as a point."""
        return 1 if self._shrinks(models, complete) else sum(len(probe.points) for probe in self._probes)

    def _shrinks(self, models: SpotModels, complete: SpotModels) -> bool:
        """Whether models treat an incoherent disc as a point."""
        return models.point and not complete.point and not self._part.spot.coherent

    def squares(self, number: int, models: SpotModels, complete: SpotModels) -> tuple[float, float]:
        """Squared L2 norms of the change of one point's pixels by models, and of the pixels by the most complete ones.

        The change is infinite where the models refuse to compute the image.
        """
        if self._shrinks(models, complete):
            return self._as_point(models, complete)
        place = divmod(number, len(self._probes[0].points))
        try:
            radius = self._spread(place[0], complete)
            seen: _Seen = "pair" if models.separate else "alone"
            ours, whole = (self._pixels(place, chosen, radius, seen) for chosen in (models, complete))
        except TradestudyError:
            return math.inf, 1.0
        return float(np.sum((ours - whole) ** 2)), float(np.sum(whole**2))

    def change_by_fixed_phase(self, models: SpotModels) -> float:
        """Relative L2 change of the points' pixels if the phase of the microlenses is fixed.

        Neighbours take part: a fixed phase shifts their oblique light most, which interferes with that of the probe.
        """
        lenses = self._part.microlenses.model_copy(update={"lens_phase": "parabolic"})
        fixed = light_trial(self._part.model_copy(update={"microlenses": lenses}))
        radii = [self._spread(index, models) for index in range(len(self._probes))]
        places = [(index, number) for index, probe in enumerate(self._probes) for number in range(len(probe.points))]
        following, parabolic = (
            np.concatenate([trial._pixels(place, models, radii[place[0]], "around").ravel() for place in places])
            for trial in (self, fixed)
        )
        return relative_change(following, parabolic)

    def _as_point(self, models: SpotModels, complete: SpotModels) -> tuple[float, float]:
        """As `squares`, for a disc that models treat as a point: its centre against points that represent the disc."""
        spot, source = self._part.spot, light_source(self._part)
        assert isinstance(source, DiscSource)  # a point does not shrink
        middle, out = source.centre, spot.diameter / 2.0 * math.sqrt(2.0 / 3.0)
        around = [
            replace(middle, x=middle.x + out * math.cos(turn), y=middle.y + out * math.sin(turn))
            for turn in (2.0 * math.pi * np.arange(_AROUND) / _AROUND).tolist()
        ]
        try:
            if complete.method in RAYS:
                centre, whole = (
                    picture_of(
                        self._part, replace(complete, tolerance=TOLERANCE, point=point), seed=self._part.seed
                    ).pixels
                    for point in (True, False)
                )
            else:
                # Exact for light that varies quadratically, or with the fourth power of the distance from the centre.
                centre = of_centre = self._followed(complete, source.centre)
                whole = of_centre / 4.0 + 0.75 * np.mean([self._followed(complete, point) for point in around], axis=0)
                if replace(models, point=False) != complete:
                    centre = self._followed(models, source.centre)
        except TradestudyError:
            return math.inf, 1.0
        return float(np.sum((centre - whole) ** 2)), float(np.sum(whole**2))

    def _followed(self, models: SpotModels, point: PointSource) -> FloatArray:
        """Pixels of one point of the disc, computed as in its picture."""
        key = models.method, models.integrated
        if key not in self._spots:
            self._spots[key] = _prepared(self._part, models)
        return self._spots[key].light((point.x, point.y)).on_pixels(self._spots[key])

    def _spread(self, index: int, models: SpotModels) -> float:
        """Radius of the image of the disc's part that lights a microlens [parts of pixels].

        It is that of a circle of equal area, of which the images of the three points form a triangle.
        """
        count = len(self._probes[index].points)
        if count == 1:
            return 0.0
        images = [self._light((index, number), models, "alone") for number in range(count)]
        if min(float(image.sum()) for image in images) <= 0.0:
            return 0.0
        first, second, third = (_centre_of_light(image) for image in images)
        (a, b), (c, d) = second - first, third - first
        inscribed = 3.0 * math.sqrt(3.0) / 4.0 * _OUT**2  # the triangle of the points, for a circle of radius 1
        return math.sqrt(abs(a * d - b * c) / 2.0 / inscribed)

    def _pixels(self, place: tuple[int, int], models: SpotModels, radius: float, seen: _Seen) -> FloatArray:
        """Pixels of one point of one probe, whose light a disc of a radius spreads."""
        light = _spread_out(self._light(place, models, seen), radius, point=models.point)
        return _on_pixels(light, integrated=models.integrated)

    def _light(self, place: tuple[int, int], models: SpotModels, seen: _Seen) -> FloatArray:
        """Light of one point of one probe on parts of pixels."""
        mean = models.monochromatic or models.method in RAYS
        lines = [(self._part.mean_wavelength, 1.0)] if mean else _lines(self._part)
        return np.asarray(sum(share * self._image(place, models, line, seen) for line, share in lines))

    def _image(self, place: tuple[int, int], models: SpotModels, wavelength: float, seen: _Seen) -> FloatArray:
        probe = self._probes[place[0]]
        plain = replace(
            models,
            tolerance=TOLERANCE,
            integrated=True,
            monochromatic=False,
            point=models.point or probe.coherent_radius == 0.0,
        )
        key = place, seen, plain, wavelength
        if key not in self._images:
            path: LightPath = getattr(probe, seen)
            self._images[key] = _point_image(path, probe.points[place[1]], probe.coherent_radius, plain, wavelength)
        return self._images[key]


def light_trial(part: LightSpotPart) -> LightTrial:
    """The trial of a part, whose images the check, the plan and the run of a study share."""
    return _light_trial(without_comparison(part))


_light_trial = lru_cache(maxsize=4)(LightTrial)


def _prepared(part: LightSpotPart, models: SpotModels) -> Spot:
    """The inputs that all points of the disc share."""
    path, source = light_path(part), light_source(part)
    assert isinstance(source, DiscSource)  # only a disc has points
    path = replace(path, pixels=replace(path.pixels, integrated=models.integrated))
    accuracy = ChainAccuracy(tolerance=_COARSE, source_sampling=_SPARSE)
    wavelength, laws = part.mean_wavelength, legs(models.method)
    return SpotRequest(path=path, source=source, wavelength=wavelength, legs=laws, accuracy=accuracy).prepared()


def _lines(part: LightSpotPart) -> list[tuple[float, float]]:
    """Wavelengths and their shares, thinned out to at most four."""
    lines = part.lines[:: -(-len(part.lines) // _MOST_LINES)]
    total = math.fsum(share for _, share in lines)
    return [(line, share / total) for line, share in lines]


def _point_image(
    path: LightPath, point: PointSource, coherent_radius: float, models: SpotModels, wavelength: float
) -> FloatArray:
    """Share of a point's light on every part of a pixel."""
    if models.separate:
        owner = nearest_microlens(path)
        total = np.zeros(owner.shape)
        for index in np.unique(owner):
            alone = replace(path, microlenses=path.microlenses.only(int(index)))
            image = _point_image(alone, point, coherent_radius, replace(models, separate=False), wavelength)
            total += np.where(owner == index, image, 0.0)
        return total
    if models.method in RAYS:
        return forward_tracer(path, point)(0, 0, _RAYS) / _RAYS
    laws = legs(models.method)
    radius = 0.0 if models.point else coherent_radius
    wave = point_wave(path, point, wavelength=wavelength, legs=laws, coherent_radius=radius)
    return compute_point(wave, laws.to_detector, ChainAccuracy(tolerance=models.tolerance)).pixels / wave.power()


def _spread_out(fine: FloatArray, radius: float, *, point: bool) -> FloatArray:
    """Pad the image of a point and convolve it with a disc of a radius [parts]; a point keeps its image."""
    fine = np.pad(fine, _PARTS * math.ceil(radius / _PARTS))  # whole pixels, so that their parts stay together
    if point or radius == 0.0:
        return fine
    f_x, f_y = scipy.fft.rfftfreq(fine.shape[1]), scipy.fft.fftfreq(fine.shape[0])
    # The transfer function of a disc, 2 J₁(t)/t, is 1 at t = 0; the smallest t avoids 0/0 there.
    turn = np.maximum(2.0 * math.pi * radius * np.hypot(f_x, f_y[:, None]), 1e-9)
    disc = 2.0 * scipy.special.j1(turn) / turn
    return np.asarray(scipy.fft.irfft2(scipy.fft.rfft2(fine) * disc, s=fine.shape))


def _centre_of_light(image: FloatArray) -> FloatArray:
    """Centroid of an image [parts of pixels], (row, column)."""
    rows, columns = np.indices(image.shape)
    return np.asarray([np.sum(image * rows), np.sum(image * columns)]) / float(image.sum())


def _on_pixels(fine: FloatArray, *, integrated: bool) -> FloatArray:
    """Pixel values: the sum over the parts of a pixel, or its central part scaled to the whole pixel."""
    if not integrated:
        return np.asarray(_PARTS**2 * fine[_PARTS // 2 :: _PARTS, _PARTS // 2 :: _PARTS])
    rows, columns = fine.shape
    return np.asarray(fine.reshape(rows // _PARTS, _PARTS, columns // _PARTS, _PARTS).sum(axis=(1, 3)))
