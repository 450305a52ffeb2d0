"""The spot behind a microlens array in one call, refined to a tolerance in sampling and number of microlenses."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from tradestudy.errors import NotConvergedError, OutOfRangeError
from tradestudy.optics.arguments import checked
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.array_field import PupilWave
from tradestudy.optics.chain.arriving_light import point_wave
from tradestudy.optics.chain.image import mean_image, refuse_following_microlenses, unguarded_image
from tradestudy.optics.chain.lit_part import missing_light
from tradestudy.optics.chain.scene import KIRCHHOFF, Legs, LightPath, Microlenses
from tradestudy.optics.chain.sources import DiscSource, spectral_shares
from tradestudy.optics.microlens_camera import MicrolensCamera, source_points
from tradestudy.optics.propagation.lens import PointSource

_ROUNDS = 4
_FINEST = 1e-6  # smallest tolerance that `ChainAccuracy` accepts
_SAFETY = 2.0  # of the light that is left out: measured at up to 1.5 times the estimate


@checked
def microlens_image(
    camera: MicrolensCamera,
    source: PointSource | DiscSource,
    *,
    wavelength: float | FloatArray,
    weights: FloatArray | None = None,
    legs: Legs = KIRCHHOFF,
    tolerance: float = 1e-3,
    seed: int = 0,
) -> ChainImage:
    """Image of a point or a disc on the pixels behind a main lens and a microlens array, within a tolerance.

    Parameters
    ----------
    camera
        Main lens, microlens array and sensor. For a plenoptic camera of a loaded study, give
        ``study.definition.case.cameras[NAME].light_chain()``, where NAME is its key in the study file.
    source
        A `PointSource` or a `DiscSource`. The intensities of the points of an incoherent disc add up; a coherent disc
        emits one wave, with the same phase at every point.
    wavelength
        Wavelength λ [m], > 0; or several, shape (n,), whose images are averaged with ``weights``.
    weights
        Power through the pupil at each wavelength [any unit], ≥ 0, not all zero, shape (n,); only the ratios matter.
        Default: equal.
    legs
        Methods of propagation to the array and to the detector, as in `chain_image`.
    tolerance
        Largest relative L2 error over the pixels [1], from 1e-6 to 0.2.
    seed
        Seed, ≥ 0, of the random points at which the result is checked; the same seed gives the same digits.

    Returns
    -------
    ChainImage
        Fraction of the power through the pupil on each pixel, with a stated error within the tolerance. The pixels are
        ``camera.light_path(source, wavelength=…).pixels``; for several wavelengths, the widest of these grids.

    Raises
    ------
    OutOfRangeError
        An argument is outside the range in which the methods hold; see `chain_image`.
    UnaffordableError
        The image, or the second computation for its error estimate, needs more than 2 GB of memory; or the source would
        have to be divided into more than about a million points.
    NotConvergedError
        The stated error stays above the tolerance after refinement.

    References
    ----------
    "Diffraction model of a plenoptic camera for in-situ space exploration", eqs. 14, 16, 22 and 25, as in
    `chain_image`.

    Examples
    --------
    >>> from tradestudy import optics
    >>> camera = optics.MicrolensCamera(
    ...     focal_length=2e-3,
    ...     f_number=8,
    ...     array_distance=2.5e-3,
    ...     microlens_focal_lengths=76e-6,
    ...     microlens_pitch=26e-6,
    ...     gap=0.1e-3,
    ...     pixel_pitch=4e-6,
    ...     pupil=optics.Pupil.from_waves({8: 0.1}, wavelength=550e-9),
    ... )
    >>> image = optics.microlens_image(camera, optics.PointSource(distance=20e-3), wavelength=550e-9, tolerance=1e-2)
    >>> rows, columns = image.pixels.shape
    >>> print(f"{image.pixels.sum():.2f} of the light on {rows} × {columns} pixels, to 1 %: {image.within_tolerance}")
    0.92 of the light on 38 × 38 pixels, to 1 %: True
    >>> grid = camera.light_path(optics.PointSource(distance=20e-3), wavelength=550e-9).pixels
    >>> print(f"from x = {grid.edges_x[0] * 1e6:.0f} to {grid.edges_x[-1] * 1e6:.0f} µm")
    from x = -76 to 76 µm
    """
    if seed < 0:
        raise OutOfRangeError("seed", value=str(seed), limit="≥ 0", remedy="give another")
    wavelengths = np.atleast_1d(np.asarray(wavelength, dtype=np.float64))
    shares = spectral_shares(wavelengths, np.ones_like(wavelengths) if weights is None else weights)
    paths = [camera.light_path(source, wavelength=float(one)) for one in wavelengths]
    widest = max((path.pixels for path in paths), key=lambda grid: grid.shape)
    lenses = max((path.microlenses for path in paths), key=lambda array: array.count)
    parts = [
        _refined(camera, replace(path, pixels=widest, microlenses=lenses), source, float(one), legs, tolerance, seed)
        for one, path in zip(wavelengths, paths, strict=True)
    ]
    return parts[0] if len(parts) == 1 else mean_image(parts, wavelengths, shares)


def _refined(
    camera: MicrolensCamera,
    path: LightPath,
    source: PointSource | DiscSource,
    wavelength: float,
    legs: Legs,
    tolerance: float,
    seed: int,
) -> ChainImage:
    """Image whose stated error is within the tolerance, with as many microlenses as that takes."""
    accuracy = ChainAccuracy(tolerance=tolerance)

    def sampled(path: LightPath) -> ChainImage:
        rng = np.random.default_rng(seed)
        return unguarded_image(path, source, wavelength=wavelength, legs=legs, accuracy=accuracy, rng=rng)

    for _ in range(_ROUNDS):
        image = sampled(path)
        around, missing = path, np.zeros(0)
        if legs.to_array != "geometric":  # rays light none beyond
            around = replace(path, microlenses=camera.next_microlenses(path, source_points(source)[0]))
            missing = _missing(around, source, wavelength, legs, image.pixels)
        terms = image.error_terms | {"microlenses left out": _SAFETY * float(np.linalg.norm(missing))}
        error = math.hypot(image.numerical_error, terms["microlenses left out"])
        if error <= tolerance:
            refuse_following_microlenses(image, path, source, legs, tolerance, sampled)
            return replace(image, numerical_error=error, error_terms=terms, tolerance=tolerance)
        if terms["microlenses left out"] > tolerance / 2:
            path = replace(path, microlenses=_joined(path.microlenses, around.microlenses, missing, tolerance / 4))
        if image.numerical_error > tolerance / 2:
            finer = max(accuracy.tolerance * min(0.3, 0.5 * tolerance / image.numerical_error), _FINEST)
            accuracy = replace(accuracy, tolerance=finer)
    raise NotConvergedError(
        "the image does not reach its tolerance",
        value=f"stated relative L2 error {error:.2g}",
        limit=f"{tolerance:g}",
        remedy="raise the tolerance; the error_terms of chain_image show what limits the error",
    )


def _missing(
    around: LightPath, source: PointSource | DiscSource, wavelength: float, legs: Legs, pixels: FloatArray
) -> FloatArray:
    """Relative L2 change of the image by each microlens around it: of a disc, by the point that changes it most."""
    coherent = source.diameter / 2 if isinstance(source, DiscSource) and source.coherent else 0.0
    points = source_points(source)[: 1 if coherent else None]
    waves = [point_wave(around, one, wavelength=wavelength, legs=legs, coherent_radius=coherent) for one in points]
    changes = [missing_light(wave.reference, around, pixels) for wave in waves if isinstance(wave, PupilWave)]
    return np.asarray(np.max(changes, axis=0))


def _joined(known: Microlenses, others: Microlenses, missing: FloatArray, allowed: float) -> Microlenses:
    """Known microlenses and those of the others without which the error would exceed what is allowed."""
    order = np.argsort(missing)
    added = order[np.sqrt(np.cumsum(missing[order] ** 2)) > allowed]
    return replace(
        known,
        centres=np.concatenate([known.centres, others.centres[added]]),
        focal_lengths=np.concatenate([known.focal_lengths, others.focal_lengths[added]]),
    )
