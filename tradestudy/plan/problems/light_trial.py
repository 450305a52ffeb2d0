"""Trials of the picture of a light spot: how much the images of a few source points differ between two sets of models.

The image of one source point behind a few microlenses takes some hundredths of a second. Convolved with the ray image
of the disc, it represents the picture around it, so that differences that the disc blurs away do not count.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
import scipy.fft
import scipy.special

from tradestudy.analysis.spot_images import RAYS, SpotModels, legs, light_path, light_source, picture_of
from tradestudy.errors import TradestudyError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain import ChainAccuracy, DiscSource, LightPath, PixelGrid
from tradestudy.optics.chain.arriving_light import blur_radius, point_wave, ray_reach
from tradestudy.optics.chain.image import microlenses_alone, nearest_microlens
from tradestudy.optics.chain.point_image import compute_point
from tradestudy.optics.chain.sampled_rays import forward_tracer
from tradestudy.optics.chain.sources import source_nodes
from tradestudy.optics.chain.spot_parts import source_density
from tradestudy.optics.chain.spot_points import Spot, point_light, prepare_spot, tables_at
from tradestudy.optics.propagation import PointSource
from tradestudy.study.schema.light_spot import LightSpotPart

TOLERANCE: Final = 2e-3  # of the images of points
# Neighbouring points of a disc share most of their numerical error; at these settings, the rest is below `TOLERANCE` of
# the picture.
_COARSE, _SPARSE = 5e-2, 0.5
_RAYS: Final = 2**15  # per point; disc and pixels average out their errors
_AROUND: Final = 6  # points that represent a disc with its centre: their mean is exact to fifth order in its radius
_PARTS: Final = 3  # along a pixel; odd, so that one of them is at its centre
_MOST_LINES: Final = 4
_MET: Final = 0.5  # of the light by waves; if rays bring less, they miss the microlenses
_AZIMUTHS: Final = 16


@dataclass(frozen=True, kw_only=True)
class Probe:
    """A source point, and the part of the light path that forms its image.

    Attributes
    ----------
    alone, pair
        A microlens alone and with its nearest neighbour, each with the pixels that belong to it, divided into parts.
    point
        Source point.
    spread
        Radius of the ray image of the disc on the detector [m], 0 for a point.
    coherent_radius
        Radius of a coherent disc about the point [m]; 0 for other sources.
    held
        Share of the edge of the disc's image that is the edge of the disc itself. The rest is the edge of the pupil,
        which does not move if the rays of a source point land elsewhere.
    """

    alone: LightPath
    pair: LightPath
    point: PointSource
    spread: float
    coherent_radius: float
    held: float


def probes(part: LightSpotPart) -> tuple[Probe, ...]:
    """The centre of the spot and points towards its edge, each with a microlens that forms its image.

    The microlenses are those nearest to the light, one of each focal length, and the last one that the spot lights.
    """
    path, source = light_path(part), light_source(part)
    owner = nearest_microlens(path)
    middle = source.centre if isinstance(source, DiscSource) else source
    radius = source.diameter / 2.0 if isinstance(source, DiscSource) else 0.0
    coherent = isinstance(source, DiscSource) and source.coherent
    found = []
    for index, places in _places(path, middle, 0.0 if coherent else radius, np.unique(owner)):
        apart = np.linalg.norm(path.microlenses.centres - path.microlenses.centres[index], axis=1)
        alone, pair = (
            _in_parts(microlenses_alone(path, [int(one) for one in np.argsort(apart, kind="stable")[:n]], owner))
            for n in (1, 2)
        )
        spread, held = (0.0, 1.0) if coherent or radius == 0.0 else _ray_image(alone, middle, radius)
        found += [
            Probe(
                alone=alone,
                pair=pair,
                point=PointSource(x=middle.x + x, y=middle.y + y, distance=middle.distance),
                spread=spread,
                coherent_radius=radius if coherent else 0.0,
                held=held,
            )
            for x, y in places
        ]
    return tuple(found)


def _in_parts(path: LightPath) -> LightPath:
    grid = path.pixels
    shape = (grid.shape[0] * _PARTS, grid.shape[1] * _PARTS)
    return replace(path, pixels=PixelGrid(pitch=grid.pitch / _PARTS, shape=shape, centre=grid.centre))


def _places(
    path: LightPath, middle: PointSource, radius: float, present: FloatArray
) -> Iterator[tuple[int, list[tuple[float, float]]]]:
    """Indices of microlenses, each with source points that light it, relative to the centre of the disc [m]."""
    lenses = path.microlenses
    away = lenses.centres[present] - path.chief_point(middle)
    distance = np.linalg.norm(away, axis=1)
    lit = distance <= blur_radius(path, middle) + radius * path.array_distance / middle.distance
    nearest = [
        int(present[np.argmin(np.where(lenses.focal_lengths[present] == kind, distance, math.inf))])
        for kind in np.unique(lenses.focal_lengths[present])
    ]
    for index in nearest:
        yield (
            index,
            [(0.0, 0.0), (0.55 * radius, 0.45 * radius), (-0.9 * radius, 0.3 * radius)][: 3 if radius > 0.0 else 1],
        )
    last = int(np.argmax(np.where(lit, distance, -1.0)))
    if int(present[last]) not in nearest:
        towards = -away[last] / distance[last] * radius
        yield int(present[last]), [(0.85 * float(towards[0]), 0.85 * float(towards[1]))]


def _ray_image(path: LightPath, middle: PointSource, radius: float) -> tuple[float, float]:
    """Radius of the disc's image behind a microlens [m], and the share of its edge that the pupil does not cut off."""
    edge = _on_circle(middle, radius, _AZIMUTHS)
    x, y = np.array([ray_reach(path, one).image[0] for one in edge]).T
    area = abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))) / 2.0
    lit = blur_radius(path, middle)
    away = [float(np.linalg.norm(path.microlenses.centres[0] - path.chief_point(one))) for one in edge]
    return math.sqrt(area / math.pi), float(np.mean(np.asarray(away) <= lit))


def _on_circle(middle: PointSource, radius: float, count: int) -> list[PointSource]:
    """Points at equal angles on a circle around `middle`."""
    return [
        PointSource(x=middle.x + radius * math.cos(a), y=middle.y + radius * math.sin(a), distance=middle.distance)
        for a in (2.0 * math.pi * np.arange(count) / count).tolist()
    ]


class LightTrial:
    """Images of a few points of a spot, each computed once."""

    def __init__(self, part: LightSpotPart) -> None:
        self._part = part
        self._spots: dict[tuple[str, bool], Spot] = {}
        self._images: dict[tuple[int, bool, SpotModels, float], FloatArray] = {}

    @cached_property
    def _probes(self) -> tuple[Probe, ...]:
        return probes(self._part)

    def count(self, models: SpotModels, complete: SpotModels) -> int:
        """Number of comparisons: the probes, or one where a disc counts as a point."""
        return 1 if self._shrinks(models, complete) else len(self._probes)

    def _shrinks(self, models: SpotModels, complete: SpotModels) -> bool:
        """Whether models treat an incoherent disc as a point."""
        return models.point and not complete.point and not self._part.spot.coherent

    def squares(self, number: int, models: SpotModels, complete: SpotModels) -> tuple[float, float]:
        """Squared L2 norms of the change of one probe's pixels by models, and of the pixels by the most complete ones.

        The change is infinite where the models refuse to compute the image, and where a probe's rays miss the
        microlenses, which then see so little of the disc that its blurred image does not represent the picture.
        """
        if self._shrinks(models, complete):
            return self._as_point(models, complete)
        probe = self._probes[number]
        try:
            fine, reference = (self._fine(number, one, pair=models.separate) for one in (models, complete))
        except TradestudyError:
            return math.inf, 1.0
        if models.method in RAYS and fine.sum() < _MET * reference.sum():
            return math.inf, 1.0
        whole = _on_pixels(reference, integrated=complete.integrated)
        shifted = [fine] if probe.held == 1.0 or models.point else [fine, _aligned(fine, reference)]
        changes = [float(np.sum((_on_pixels(one, integrated=models.integrated) - whole) ** 2)) for one in shifted]
        return probe.held * changes[0] + (1.0 - probe.held) * changes[-1], float(np.sum(whole**2))

    def _as_point(self, models: SpotModels, complete: SpotModels) -> tuple[float, float]:
        """As `squares`, for a disc that models treat as a point: its centre against points that represent the disc."""
        spot, source = self._part.spot, light_source(self._part)
        assert isinstance(source, DiscSource)  # a point does not shrink
        around = _on_circle(source.centre, spot.diameter / 2.0 * math.sqrt(2.0 / 3.0), _AROUND)
        try:
            if complete.method in RAYS:
                accuracy = ChainAccuracy(tolerance=TOLERANCE)
                centre, whole = (
                    picture_of(self._part, one, complete, accuracy=accuracy, seed=self._part.seed).pixels
                    for one in (source.centre, source)
                )
            else:
                # J. Radon's formula of degree five, Monatsh. Math. Phys. 52 (1948) 286.
                centre = own = self._followed(complete, source.centre)
                whole = own / 4.0 + 0.75 * np.mean([self._followed(complete, one) for one in around], axis=0)
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
        spot, at = self._spots[key], (point.x, point.y)
        return point_light(spot, at, tables_at(spot, [at])[at]).on_pixels(spot)

    def _fine(self, number: int, models: SpotModels, *, pair: bool) -> FloatArray:
        """Light of the disc on parts of pixels, as if all its points had the same image as the probe."""
        mean = models.monochromatic or models.method in RAYS
        lines = [(self._part.mean_wavelength, 1.0)] if mean else _lines(self._part)
        fine = sum(share * self._image(number, models, line, pair=pair) for line, share in lines)
        probe = self._probes[number]
        return _spread_out(np.asarray(fine), probe.spread / probe.alone.pixels.pitch, point=models.point)

    def _image(self, number: int, models: SpotModels, wavelength: float, *, pair: bool) -> FloatArray:
        probe = self._probes[number]
        plain = replace(
            models,
            tolerance=TOLERANCE,
            integrated=True,
            monochromatic=False,
            point=models.point or probe.coherent_radius == 0.0,
        )
        key = number, pair, plain, wavelength
        if key not in self._images:
            self._images[key] = _point_image(probe, probe.pair if pair else probe.alone, plain, wavelength)
        return self._images[key]


def _prepared(part: LightSpotPart, models: SpotModels) -> Spot:
    """The inputs that all points of the disc share."""
    path, source = light_path(part), light_source(part)
    assert isinstance(source, DiscSource)  # only a disc has points
    path = replace(path, pixels=replace(path.pixels, integrated=models.integrated))
    accuracy = ChainAccuracy(tolerance=_COARSE, source_sampling=_SPARSE)
    nodes = source_nodes(path, source, wavelength=part.mean_wavelength, density=source_density(accuracy))
    return prepare_spot(path, source, nodes, part.mean_wavelength, legs(models.method), accuracy)


def _lines(part: LightSpotPart) -> list[tuple[float, float]]:
    """Wavelengths and their shares, thinned out to at most four."""
    lines = part.lines[:: -(-len(part.lines) // _MOST_LINES)]
    total = math.fsum(share for _, share in lines)
    return [(line, share / total) for line, share in lines]


def _point_image(probe: Probe, path: LightPath, models: SpotModels, wavelength: float) -> FloatArray:
    """Share of the point's light on every part of a pixel."""
    if models.separate:
        owner = nearest_microlens(path)
        total = np.zeros(owner.shape)
        for index in np.unique(owner):
            alone = replace(path, microlenses=path.microlenses.only(int(index)))
            image = _point_image(probe, alone, replace(models, separate=False), wavelength)
            total += np.where(owner == index, image, 0.0)
        return total
    if models.method in RAYS:
        return forward_tracer(path, probe.point)(0, 0, _RAYS) / _RAYS
    laws = legs(models.method)
    coherent_radius = 0.0 if models.point else probe.coherent_radius
    wave = point_wave(path, probe.point, wavelength=wavelength, legs=laws, coherent_radius=coherent_radius)
    return compute_point(wave, laws.to_detector, ChainAccuracy(tolerance=models.tolerance)).pixels / wave.power()


def _spread_out(fine: FloatArray, radius: float, *, point: bool) -> FloatArray:
    """Pad the image of a point and convolve it with a disc of a radius [parts]; a point keeps its image."""
    fine = np.pad(fine, _PARTS * math.ceil(radius / _PARTS))
    if point or radius == 0.0:
        return fine
    turn = 2.0 * math.pi * radius * _frequencies(fine)
    return np.asarray(scipy.fft.irfft2(scipy.fft.rfft2(fine) * _jinc(turn), s=fine.shape))


def _frequencies(fine: FloatArray) -> FloatArray:
    f_x, f_y = scipy.fft.rfftfreq(fine.shape[1]), scipy.fft.fftfreq(fine.shape[0])
    return np.hypot(f_x, f_y[:, None])


def _jinc(turn: FloatArray) -> FloatArray:
    """2 J₁(t)/t."""
    turn = np.maximum(turn, 1e-9)
    return np.asarray(2.0 * scipy.special.j1(turn) / turn)


def _aligned(fine: FloatArray, reference: FloatArray) -> FloatArray:
    """Shift a picture to match a reference best: first by whole parts, then by fractions of one, to first order."""
    alike = scipy.fft.irfft2(scipy.fft.rfft2(reference) * np.conj(scipy.fft.rfft2(fine)), s=fine.shape)
    rows, columns = np.unravel_index(np.argmax(alike), alike.shape)
    moved = np.roll(fine, (int(rows), int(columns)), axis=(0, 1))
    slopes = np.stack([one.ravel() for one in np.gradient(moved)], axis=1)
    by, *_ = np.linalg.lstsq(slopes, (reference - moved).ravel(), rcond=None)
    return np.asarray(moved + (slopes @ by).reshape(moved.shape))


def _on_pixels(fine: FloatArray, *, integrated: bool) -> FloatArray:
    """Pixel values: the sum over the parts of a pixel, or its central part scaled to the whole pixel."""
    if not integrated:
        return np.asarray(_PARTS**2 * fine[_PARTS // 2 :: _PARTS, _PARTS // 2 :: _PARTS])
    rows, columns = fine.shape
    return np.asarray(fine.reshape(rows // _PARTS, _PARTS, columns // _PARTS, _PARTS).sum(axis=(1, 3)))
