"""The image by rays of exact directions: everything of Kirchhoff's image but diffraction and interference.

The volume d²s d²u of pairs of source and pupil points makes it an integral over any other pair of planes: gaps and
perfect lenses keep the volume of position times slope, lenses of a fixed phase that of position times direction cosine.
Rays start where the fewest of them are lost: at the detector, at the array or at the source.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.pixels import refuse_pixel_centres
from tradestudy.optics.chain.sampled_rays import AT_ONCE, Tracer
from tradestudy.optics.chain.scene import LightPath
from tradestudy.optics.chain.sources import DiscSource, lens_orbits, symmetries
from tradestudy.optics.chain.traced_backwards import backward_rays, traced_backwards
from tradestudy.optics.chain.traced_forwards import forward_tracer
from tradestudy.optics.chain.traced_from_array import array_tracer, cell_area
from tradestudy.optics.propagation.lens import PointSource

StartOfRays = Literal["detector", "array", "source"]

_COARSER = 0.7
SHIFTS = 8  # of the sequence that places sampled rays
_SAFETY = 2.5  # on the change of samples, whose errors may fall as slowly as their spacing
_STANDARD_ERRORS = 3.0  # of few shifts, and of pictures that may hold no more than one number
_MOST_REFINEMENTS = 2
_TOLERANCE_OF_ONE = 2e-2  # that a density of 1 meets
_WIDTH_OF_ONE = 2.0  # radius of such an image [pixels]
_LEAST_DENSITY = 0.75  # three samples across a pixel against two
_FEWEST_PIXELS = 2.0  # from the middle of the image of a disc to its edge, to be traced from the detector
_PILOT_RAYS = 2**13
_ORDER = 0.6  # errors of sampled rays fall with this power of their number, about, or a little faster
_WHERE_DARK = 2**20  # rays where none of the pilot's finds a pixel
_MOST_RAYS = 1e8


def exact_ray_image(path: LightPath, source: PointSource | DiscSource, *, accuracy: ChainAccuracy) -> ChainImage:
    """Share of the pupil's light on each pixel by rays that the exact phases of the lenses turn.

    Parameters
    ----------
    path
        The camera.
    source
        Point, or disc whose points radiate on their own.
    accuracy
        What to aim at; `source_sampling` refines all samples.

    Returns
    -------
    ChainImage
        ``numerical_error`` is 3 standard errors of eight shifts of the rays, or, of rays from the detector, 2.5 times
        the change against 0.7 times the samples. Where it misses the tolerance, rays are increased twice at most.

    Raises
    ------
    OutOfRangeError
        If pixels are not to integrate.
    """
    refuse_pixel_centres(path.pixels)
    if isinstance(source, DiscSource) and start_of_rays(path, source) == "detector":
        pixels, change, traced = _from_detector(path, source, accuracy)
    else:
        pixels, change, traced = _sampled(path, source, accuracy)
    return ChainImage(
        pixels=pixels,
        numerical_error=change,
        error_terms={"coarser computation": change},
        direct_check={},
        microlens_share=math.nan,
        effort={"rays": round(traced)},
    )


def start_of_rays(path: LightPath, source: PointSource | DiscSource) -> StartOfRays:
    """Plane that rays start from.

    The detector samples images that are wide against its pixels. Of all rays from the source those that meet the array
    count, of those through the array those that meet the source: the smaller of the two areas, seen through the middle
    of the pupil, loses less.
    """
    if isinstance(source, PointSource):
        return "source"
    if _image_radius(path, source) >= _FEWEST_PIXELS:
        return "detector"
    array = path.microlenses.count * cell_area(path.microlenses) * (source.distance / path.array_distance) ** 2
    return "array" if array < math.pi * (source.diameter / 2.0) ** 2 else "source"


def ray_count(path: LightPath, source: PointSource | DiscSource, accuracy: ChainAccuracy) -> float:
    """Rays that are traced before any refinement, what states the error included."""
    if isinstance(source, DiscSource) and start_of_rays(path, source) == "detector":
        density = _density(path, source, accuracy)
        return sum(backward_rays(path, source, density * factor) for factor in (1.0, _COARSER))
    return _lenses_traced(path, source) * _needed(path, source, accuracy) + _PILOT_RAYS


def _from_detector(path: LightPath, source: DiscSource, accuracy: ChainAccuracy) -> tuple[FloatArray, float, float]:
    """Picture, its error, and rays."""
    density = _density(path, source, accuracy)
    traced = ray_count(path, source, accuracy)
    coarse, fine = (traced_backwards(path, source, density * factor) for factor in (_COARSER, 1.0))
    change = _against(coarse, fine)
    for _ in range(_MOST_REFINEMENTS):
        if change <= accuracy.tolerance:
            break
        density /= _COARSER
        traced += backward_rays(path, source, density)
        coarse, fine = fine, traced_backwards(path, source, density)
        change = _against(coarse, fine)
    return fine, change, traced


def _density(path: LightPath, source: DiscSource, accuracy: ChainAccuracy) -> float:
    """Factor on the numbers of samples across a pixel and of nodes on a microlens.

    Edges of pupil and source that fall between samples leave an error that falls with its square, about, and with the
    width of the image, of which edges are a smaller part.
    """
    wide = max(1.0, _image_radius(path, source) / _WIDTH_OF_ONE)
    needed = math.sqrt(_TOLERANCE_OF_ONE / accuracy.tolerance / wide)
    return accuracy.source_sampling * max(_LEAST_DENSITY, needed)


def _sampled(
    path: LightPath, source: PointSource | DiscSource, accuracy: ChainAccuracy
) -> tuple[FloatArray, float, float]:
    """Picture, its error, and rays."""
    trace = _tracer(path, source)
    each = _needed(path, source, accuracy) // SHIFTS
    sums = np.stack([_sum(trace, shifted, 0, each) for shifted in range(SHIFTS)])
    for _ in range(_MOST_REFINEMENTS):
        if _scatter(sums) <= accuracy.tolerance or 2 * SHIFTS * each > _MOST_RAYS:
            break
        sums += np.stack([_sum(trace, shifted, each, 2 * each) for shifted in range(SHIFTS)])
        each *= 2
    traced = _lenses_traced(path, source) * SHIFTS * each + _PILOT_RAYS
    return np.asarray(sums.mean(axis=0) / each), _scatter(sums), traced


def _needed(path: LightPath, source: PointSource | DiscSource, accuracy: ChainAccuracy) -> int:
    """Rays to trace, through every microlens where they start at the array: from the error that a few of them have."""
    if start_of_rays(path, source) == "array":
        path = _typical_microlens(path, source)
    trace = _tracer(path, source)
    change = _scatter(np.stack([trace(shifted, 0, _PILOT_RAYS // SHIFTS) for shifted in range(SHIFTS)]))
    needed = _PILOT_RAYS * math.pow(change / accuracy.tolerance, 1.0 / _ORDER) if change > 0.0 else _WHERE_DARK
    return round(min(max(accuracy.source_sampling * needed, _PILOT_RAYS), _MOST_RAYS))


def _typical_microlens(path: LightPath, source: PointSource | DiscSource) -> LightPath:
    """The camera with one microlens, of those seen by pixels the one that looks at the middle of the source."""
    lenses, pixels = path.microlenses, path.pixels
    middles = lenses.centres * (1.0 + path.detector_distance / path.array_distance)
    half = np.array(pixels.shape[::-1]) * pixels.pitch / 2.0
    seen = np.all(np.abs(middles - pixels.centre) <= half, axis=1)
    place = source.centre if isinstance(source, DiscSource) else source
    aside = np.linalg.norm(lenses.centres - path.chief_point(place), axis=1)
    index = [int(np.argmin(np.where(seen, aside, aside + (np.ptp(aside) + lenses.pitch))))]
    one = replace(lenses, centres=lenses.centres[index], focal_lengths=lenses.focal_lengths[index])
    return replace(path, microlenses=one)


def _lenses_traced(path: LightPath, source: PointSource | DiscSource) -> int:
    """Microlenses that rays are traced through one after another."""
    if isinstance(source, PointSource) or start_of_rays(path, source) != "array":
        return 1
    return sum(1 for _ in lens_orbits(path.microlenses.centres, symmetries(path, source)))


def _tracer(path: LightPath, source: PointSource | DiscSource) -> Tracer:
    if isinstance(source, DiscSource) and start_of_rays(path, source) == "array":
        return array_tracer(path, source)
    return forward_tracer(path, source)


def _sum(trace: Tracer, shifted: int, start: int, stop: int) -> FloatArray:
    """Rays of a long stretch, some at once."""
    first, *others = (trace(shifted, at, min(at + AT_ONCE, stop)) for at in range(start, stop, AT_ONCE))
    return sum(others, first)


def _scatter(sums: FloatArray) -> float:
    """Error of the mean of pictures that err each on its own, relative L2, by how they scatter."""
    mean = sums.mean(axis=0)
    size = math.sqrt(float(np.sum(mean**2)))
    count = sums.shape[0]
    scatter = math.sqrt(float(np.sum((sums - mean) ** 2)) / (count * (count - 1)))
    return _STANDARD_ERRORS * scatter / size if size > 0.0 else 0.0


def _against(coarse: FloatArray, fine: FloatArray) -> float:
    """Error of the finer of two pictures from the detector, relative L2."""
    size = float(np.linalg.norm(fine))
    return _SAFETY * float(np.linalg.norm(fine - coarse)) / size if size > 0.0 else 0.0


def _image_radius(path: LightPath, source: DiscSource) -> float:
    """Of a disc behind a microlens [pixels], no larger than the image of the pupil may be."""
    _, _, depth = path.image_at_array(source.centre)
    at_main_image = source.diameter / 2.0 * abs(path.array_distance - depth) / source.distance
    largest = path.main_lens.radius / path.array_distance
    seen = largest if at_main_image >= largest * abs(depth) else at_main_image / abs(depth)
    return path.detector_distance / path.pixels.pitch * seen
