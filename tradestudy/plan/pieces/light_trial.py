"""Trials of the picture of a light spot: how much the images of a few source points differ between two sets of models.

The image of one source point behind a few microlenses takes some hundredths of a second. Convolved with the ray image
of the disc, it represents the picture around it, so that differences that the disc blurs away do not count.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy.fft
import scipy.special

from tradestudy.analysis.spot_images import RAYS, SpotModels, legs, light_path, light_source
from tradestudy.errors import TradestudyError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain import ChainAccuracy, DiscSource, LightPath, PixelGrid
from tradestudy.optics.chain.arriving_light import blur_radius, point_wave, ray_reach
from tradestudy.optics.chain.image import microlenses_alone, nearest_microlens
from tradestudy.optics.chain.point_image import compute_point
from tradestudy.optics.chain.sampled_rays import forward_tracer
from tradestudy.optics.propagation import PointSource
from tradestudy.study.schema.light_spot import LightSpotPart

TOLERANCE: Final = 2e-3  # of the images of points
_RAYS: Final = 2**15  # per point; disc and pixels average out their errors
_AROUND: Final = 3  # points that represent a disc: their mean is exact to second order in its radius
_PARTS: Final = 3  # along a pixel; odd, so that one of them is at its centre
_MOST_LINES: Final = 4
_AZIMUTHS: Final = 16
_BLURRED: Final = 0.3  # relative change by blur alone, above which a disc is clearly not a point


@dataclass(frozen=True, kw_only=True)
class Probe:
    """A source point, and the part of the light path that forms its image.

    Attributes
    ----------
    alone, pair
        A microlens alone and with its nearest neighbour, each with the pixels that belong to it, divided into parts.
    point
        Source point.
    middle, around
        Centre of the disc, and three points at 1/√2 of its radius.
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
    middle: PointSource
    around: tuple[PointSource, ...]
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
    around = tuple(_on_circle(middle, radius / math.sqrt(2.0), _AROUND))
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
                middle=middle,
                around=around,
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
        self._probes = probes(part)
        self._images: dict[tuple[int, PointSource, SpotModels, float], FloatArray] = {}

    @property
    def size(self) -> int:
        """Number of probes."""
        return len(self._probes)

    def numbers(self, models: SpotModels, complete: SpotModels) -> tuple[int, ...]:
        """Probes that distinguish models: one behind each microlens where a disc counts as a point, otherwise all."""
        if not models.point or complete.point:
            return tuple(range(len(self._probes)))
        return tuple({id(one.alone): number for number, one in reversed(list(enumerate(self._probes)))}.values())

    def squares(self, number: int, models: SpotModels, complete: SpotModels) -> tuple[float, float]:
        """Squared L2 norms of the change of one probe's pixels by models, and of the pixels by the most complete ones.

        The change is infinite where the models refuse to compute the image.
        """
        probe = self._probes[number]
        if models.point and not complete.point and probe.coherent_radius == 0.0:
            return self._as_point(number, models, complete)
        try:
            fine, reference = (self._fine(number, one, pair=models.separate) for one in (models, complete))
        except TradestudyError:
            return math.inf, 1.0
        whole = _on_pixels(reference, integrated=complete.integrated)
        shifted = [fine] if probe.held == 1.0 or models.point else [fine, _aligned(fine, reference)]
        changes = [float(np.sum((_on_pixels(one, integrated=models.integrated) - whole) ** 2)) for one in shifted]
        return probe.held * changes[0] + (1.0 - probe.held) * changes[-1], float(np.sum(whole**2))

    def _as_point(self, number: int, models: SpotModels, complete: SpotModels) -> tuple[float, float]:
        """As `squares`, for a disc that models treat as a point.

        The image of the centre is compared with the blurred one or, for a small disc, with the mean image of three
        points that represent it. These light a microlens unevenly, which blurring alone does not reproduce.
        """
        probe, line = self._probes[number], self._part.mean_wavelength
        try:
            fine, middle = (
                self._image(number, one, line, pair=models.separate, point=probe.middle) for one in (models, complete)
            )
        except TradestudyError:
            return math.inf, 1.0
        whole = _on_pixels(
            _spread_out(middle, probe.spread / probe.alone.pixels.pitch, point=False), integrated=complete.integrated
        )
        padded = _spread_out(fine, probe.spread / probe.alone.pixels.pitch, point=True)
        changed = float(np.sum((_on_pixels(padded, integrated=models.integrated) - whole) ** 2))
        own = float(np.sum(whole**2))
        if changed > _BLURRED**2 * own:
            return changed, own
        around = np.mean(
            [self._image(number, complete, line, pair=models.separate, point=one) for one in probe.around], axis=0
        )
        whole = _on_pixels(around, integrated=complete.integrated)
        change = _on_pixels(fine, integrated=models.integrated) - whole
        return float(np.sum(change**2)), float(np.sum(whole**2))

    def _fine(self, number: int, models: SpotModels, *, pair: bool) -> FloatArray:
        """Light of the disc on parts of pixels, as if all its points had the same image as the probe."""
        mean = models.monochromatic or models.method in RAYS
        lines = [(self._part.mean_wavelength, 1.0)] if mean else _lines(self._part)
        fine = sum(share * self._image(number, models, line, pair=pair) for line, share in lines)
        probe = self._probes[number]
        return _spread_out(np.asarray(fine), probe.spread / probe.alone.pixels.pitch, point=models.point)

    def _image(
        self, number: int, models: SpotModels, wavelength: float, *, pair: bool, point: PointSource | None = None
    ) -> FloatArray:
        probe = self._probes[number]
        at = point or probe.point
        plain = replace(
            models,
            tolerance=TOLERANCE,
            integrated=True,
            monochromatic=False,
            point=models.point or probe.coherent_radius == 0.0,
        )
        path = probe.pair if pair else probe.alone
        key = id(path), at, plain, wavelength  # probes of one microlens share its path
        if key not in self._images:
            self._images[key] = _point_image(replace(probe, point=at), path, plain, wavelength)
        return self._images[key]


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
