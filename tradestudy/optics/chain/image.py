"""Image of a point, a disc or a spectrum through main lens and microlenses on the pixels, by a law for each leg.

`chain_image` adds the light of all microlenses; `separate_image` lets every pixel see only one, without cross-talk.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from scipy.spatial import cKDTree

from tradestudy.optics.argument_types import checked
from tradestudy.optics.arrays import BoolArray, FloatArray, IndexArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage
from tradestudy.optics.chain.array_field import PupilWave
from tradestudy.optics.chain.arriving_light import point_wave
from tradestudy.optics.chain.exact_rays import exact_ray_image
from tradestudy.optics.chain.geometric_image import geometric_image
from tradestudy.optics.chain.landing import landing_point_image
from tradestudy.optics.chain.landing_spot import landing_spot_image
from tradestudy.optics.chain.microlens_edges import refuse_square_edges
from tradestudy.optics.chain.parts import ComputeParts, in_turn
from tradestudy.optics.chain.point_image import wave_point_image
from tradestudy.optics.chain.refusals import refuse_impossible
from tradestudy.optics.chain.scene import EXACT_RAYS, GEOMETRIC, Legs, LightPath
from tradestudy.optics.chain.sources import DiscSource, spectral_shares
from tradestudy.optics.chain.spot_image import wave_spot_image
from tradestudy.optics.propagation.lens import PointSource

_EQUALLY_NEAR = 4  # largest number of microlenses equally near to a pixel, on a square array


@checked
def chain_image(
    path: LightPath,
    source: PointSource | DiscSource,
    *,
    wavelength: float,
    legs: Legs,
    accuracy: ChainAccuracy,
    rng: np.random.Generator,
    done: Callable[[float], None] = lambda _share: None,
    compute: ComputeParts = in_turn,
) -> ChainImage:
    """Light on every pixel: source → main lens → array → all microlenses → detector, coherent over microlenses.

    U(σ) = Σ_k ∬ dx ∬ du of the product of the wave behind the main lens, the kernel to the array, the phase and
    aperture of microlens k, and the kernel to the detector. |U|² is integrated over each pixel and divided by the power
    in the pupil.

    Parameters
    ----------
    path
        Lenses, distances, pixels.
    source
        Point, incoherent disc (the intensities of its points are averaged) or coherent disc (one phase throughout).
    wavelength
        λ [m], > 0.
    legs
        Law of propagation on each leg. Rays to the array and waves behind it: each microlens receives a spherical wave
        about the main lens's image, cut off by the shadow of the pupil. Waves to the array and rays behind it: each
        array point sends its irradiance to one place, and nothing interferes. Boundary wave behind the array: it
        carries the spherical part of each microlens's light, and Kirchhoff's integral the rest. A coherent disc needs
        ``fresnel`` or ``kirchhoff`` on both legs.
    accuracy
        Tolerance, sampling and memory limit.
    rng
        Draws the targets that are checked against direct quadrature.
    done
        Called with the completed fraction of an incoherent disc's points, while their waves propagate behind the array.
    compute
        Computes groups of those points, here or on workers; the image does not depend on where.

    Returns
    -------
    ChainImage
        Fraction of the pupil's power on each pixel, with its numerical error. An image whose error exceeds the
        tolerance is returned with `ChainImage.within_tolerance` False; `microlens_image` refines it or refuses.

    Raises
    ------
    OutOfRangeError
        If the wavelength exceeds an aperture or a distance, rays or boundary waves are requested for a coherent source,
        a boundary wave is requested behind square microlenses, or rays on one leg meet an array in the focus of the
        main lens.
    UnaffordableError
        If nodes or samples need more memory than allowed.
    NotConvergedError
        If the fast path disagrees grossly with direct quadrature, or Kirchhoff's integral misses the tolerance where
        it replaces a boundary wave.

    References
    ----------
    "Diffraction model of a plenoptic camera for in-situ space exploration", eqs. 14, 16, 22 and 25, with these
    corrections: the leg to the array needs absolute array coordinates (eqs. 23–26 print local ones); the constant
    phases of eqs. 25 and 26 should read a_M + z + b_L; they drop out of every intensity.

    Examples
    --------
    >>> import numpy as np
    >>> from tradestudy import optics
    >>> lenses = optics.Microlenses(
    ...     centres=optics.square_centres(pitch=26e-6, count=3),
    ...     focal_lengths=np.full(9, 76e-6),
    ...     aperture="circular",
    ...     aperture_width=24e-6,
    ...     pitch=26e-6,
    ...     layout="square",
    ...     gaps="opaque",
    ...     lens_phase="parabolic",
    ... )
    >>> path = optics.LightPath(
    ...     main_lens=optics.CircularLens(radius=0.1e-3, focal_length=2e-3, lens_phase="parabolic"),
    ...     microlenses=lenses,
    ...     array_distance=2.5e-3,
    ...     detector_distance=0.1e-3,
    ...     pixels=optics.PixelGrid(pitch=4e-6, shape=(21, 21)),
    ... )
    >>> image = optics.chain_image(
    ...     path,
    ...     optics.PointSource(distance=20e-3),
    ...     wavelength=550e-9,
    ...     legs=optics.KIRCHHOFF,
    ...     accuracy=optics.ChainAccuracy(tolerance=1e-2),
    ...     rng=np.random.default_rng(1),
    ... )
    >>> print(f"{image.pixels.sum():.2f} of the light on the detector")
    0.83 of the light on the detector
    """
    found = _image(
        path, source, wavelength=wavelength, legs=legs, accuracy=accuracy, rng=rng, done=done, compute=compute
    )
    return replace(found, tolerance=accuracy.tolerance)


def _image(
    path: LightPath,
    source: PointSource | DiscSource,
    *,
    wavelength: float,
    legs: Legs,
    accuracy: ChainAccuracy,
    rng: np.random.Generator,
    done: Callable[[float], None],
    compute: ComputeParts,
) -> ChainImage:
    """Image by the laws of the legs."""
    refuse_impossible(path, source, wavelength, legs)
    coherent = isinstance(source, DiscSource) and source.coherent
    if legs.to_detector == "boundary_wave":
        refuse_square_edges(path.microlenses)
    if legs == GEOMETRIC:
        return geometric_image(path, source, density=accuracy.source_sampling)
    if legs == EXACT_RAYS:
        return exact_ray_image(path, source, accuracy=accuracy)
    if isinstance(source, DiscSource) and not coherent:
        if legs.to_detector == "geometric":
            return landing_spot_image(path, source, wavelength=wavelength, legs=legs, accuracy=accuracy, rng=rng)
        return wave_spot_image(
            path, source, wavelength=wavelength, legs=legs, accuracy=accuracy, rng=rng, done=done, compute=compute
        )
    wave = point_wave(
        path,
        source.centre if isinstance(source, DiscSource) else source,
        wavelength=wavelength,
        legs=legs,
        coherent_radius=source.diameter / 2 if isinstance(source, DiscSource) else 0.0,
    )
    if isinstance(wave, PupilWave) and legs.to_detector == "geometric":
        return landing_point_image(wave, accuracy=accuracy, rng=rng)
    return wave_point_image(wave, to_detector=legs.to_detector, accuracy=accuracy, rng=rng)


@checked
def spectral_image(
    path: LightPath,
    source: PointSource | DiscSource,
    *,
    wavelengths: FloatArray,
    weights: FloatArray,
    legs: Legs,
    accuracy: ChainAccuracy,
    rng: np.random.Generator,
) -> ChainImage:
    """Weighted mean of the images at several wavelengths, which add as intensities.

    Parameters
    ----------
    path, source, legs, accuracy, rng
        As in `chain_image`.
    wavelengths
        Wavelengths [m], shape (n,).
    weights
        Power in the pupil at each wavelength [any unit], ≥ 0, not all zero, shape (n,); only the ratios matter.

    Raises
    ------
    OutOfRangeError
        If shapes differ or weights violate the above; otherwise as for `chain_image`.

    Returns
    -------
    ChainImage
        The mean image; its error is the weighted sum of the errors of the images at the single wavelengths.

    References
    ----------
    Light of different wavelengths does not interfere: Born and Wolf, section 7.5.8.

    Examples
    --------
    >>> import numpy as np
    >>> from tradestudy import optics
    >>> lenses = optics.Microlenses(
    ...     centres=optics.square_centres(pitch=26e-6, count=3),
    ...     focal_lengths=np.full(9, 76e-6),
    ...     aperture="circular",
    ...     aperture_width=24e-6,
    ...     pitch=26e-6,
    ...     layout="square",
    ...     gaps="opaque",
    ...     lens_phase="parabolic",
    ... )
    >>> path = optics.LightPath(
    ...     main_lens=optics.CircularLens(radius=0.1e-3, focal_length=2e-3, lens_phase="parabolic"),
    ...     microlenses=lenses,
    ...     array_distance=2.5e-3,
    ...     detector_distance=0.1e-3,
    ...     pixels=optics.PixelGrid(pitch=4e-6, shape=(21, 21)),
    ... )
    >>> image = optics.spectral_image(
    ...     path,
    ...     optics.PointSource(distance=20e-3),
    ...     wavelengths=np.array([500e-9, 600e-9]),
    ...     weights=np.array([1.0, 1.0]),
    ...     legs=optics.KIRCHHOFF,
    ...     accuracy=optics.ChainAccuracy(tolerance=1e-2),
    ...     rng=np.random.default_rng(1),
    ... )
    >>> list(image.error_terms)
    ['500 nm', '600 nm']
    """
    shares = spectral_shares(wavelengths, weights)
    parts = [chain_image(path, source, wavelength=float(w), legs=legs, accuracy=accuracy, rng=rng) for w in wavelengths]
    return mean_image(parts, wavelengths, shares)


def mean_image(parts: Sequence[ChainImage], wavelengths: FloatArray, share: FloatArray) -> ChainImage:
    """Mean of images at several wavelengths [m], weighted by shares that sum to 1; their errors add up."""
    pixels = np.tensordot(share, [part.pixels for part in parts], axes=1)
    size = float(np.linalg.norm(pixels)) or 1.0  # no light: no error
    errors = [
        float(s * part.numerical_error * np.linalg.norm(part.pixels)) for s, part in zip(share, parts, strict=True)
    ]
    return ChainImage(
        pixels=pixels,
        numerical_error=math.fsum(errors) / size,
        error_terms={f"{w * 1e9:.6g} nm": e / size for w, e in zip(wavelengths, errors, strict=True)},
        direct_check={name: max(part.direct_check[name] for part in parts) for name in parts[0].direct_check},
        microlens_share=float(share @ [part.microlens_share for part in parts]),
        effort={name: sum(part.effort[name] for part in parts) for name in parts[0].effort},
        handed_over=max(part.handed_over for part in parts),
        tolerance=max(part.tolerance for part in parts),
    )


@checked
def separate_image(
    path: LightPath,
    source: PointSource | DiscSource,
    *,
    wavelength: float,
    legs: Legs,
    accuracy: ChainAccuracy,
    rng: np.random.Generator,
    done: Callable[[float], None] = lambda _share: None,
    compute: ComputeParts = in_turn,
) -> ChainImage:
    """Light on every pixel from its own microlens alone: the nearest one, as seen from the centre of the main lens.

    Light that lands behind a neighbouring microlens is lost, and light of different microlenses does not interfere.

    Parameters
    ----------
    path, source, wavelength, legs, accuracy, rng
        As in `chain_image`.
    done
        Called with the completed fraction of the microlenses, after each of them.
    compute
        Computes groups of microlenses, here or on workers; the image does not depend on where.

    Returns
    -------
    ChainImage
        As for `chain_image`, without cross-talk; the errors of the microlenses add in quadrature.

    Raises
    ------
    OutOfRangeError, UnaffordableError, NotConvergedError
        As for `chain_image`.

    References
    ----------
    By definition, `chain_image` of one microlens at a time.

    Examples
    --------
    >>> import numpy as np
    >>> from tradestudy import optics
    >>> lenses = optics.Microlenses(
    ...     centres=optics.square_centres(pitch=26e-6, count=3),
    ...     focal_lengths=np.full(9, 76e-6),
    ...     aperture="circular",
    ...     aperture_width=24e-6,
    ...     pitch=26e-6,
    ...     layout="square",
    ...     gaps="opaque",
    ...     lens_phase="parabolic",
    ... )
    >>> path = optics.LightPath(
    ...     main_lens=optics.CircularLens(radius=0.1e-3, focal_length=2e-3, lens_phase="parabolic"),
    ...     microlenses=lenses,
    ...     array_distance=2.5e-3,
    ...     detector_distance=0.1e-3,
    ...     pixels=optics.PixelGrid(pitch=4e-6, shape=(21, 21)),
    ... )
    >>> image = optics.separate_image(
    ...     path,
    ...     optics.PointSource(distance=20e-3),
    ...     wavelength=550e-9,
    ...     legs=optics.KIRCHHOFF,
    ...     accuracy=optics.ChainAccuracy(tolerance=1e-2),
    ...     rng=np.random.default_rng(1),
    ... )
    >>> print(f"{image.pixels.sum():.2f} of the light behind its own microlens")
    0.82 of the light behind its own microlens
    """
    owner = nearest_microlens(path)
    present = np.unique(owner)
    seeds = rng.integers(
        2**63, size=present.size
    )  # one for each microlens, so that the place of computation does not matter
    found: list[ChainImage] = compute(
        [
            partial(_alone, microlenses_alone(path, [index], owner), source, wavelength, legs, accuracy, seed)
            for index, seed in zip(present.tolist(), seeds.tolist(), strict=True)
        ],
        done,
    )
    pixels = np.zeros(owner.shape)
    for index, alone in zip(present, found, strict=True):
        mine = owner == index
        pixels[_window(mine)] += np.where(mine[_window(mine)], alone.pixels, 0.0)
    errors = [one.numerical_error * float(np.linalg.norm(one.pixels)) for one in found]
    size = float(np.linalg.norm(pixels))
    error = math.hypot(*errors) / size if size > 0.0 else 0.0
    return ChainImage(
        pixels=pixels,
        numerical_error=error,
        error_terms={"microlenses alone": error},
        direct_check={name: max(one.direct_check[name] for one in found) for name in found[0].direct_check},
        microlens_share=math.fsum(one.microlens_share for one in found),
        effort={name: sum(one.effort[name] for one in found) for name in found[0].effort},
        handed_over=max(one.handed_over for one in found),
        tolerance=accuracy.tolerance,
    )


def _alone(
    path: LightPath,
    source: PointSource | DiscSource,
    wavelength: float,
    legs: Legs,
    accuracy: ChainAccuracy,
    seed: int,
) -> ChainImage:
    """Image through a single microlens."""
    rng = np.random.default_rng(seed)
    return chain_image(path, source, wavelength=wavelength, legs=legs, accuracy=accuracy, rng=rng)


def nearest_microlens(path: LightPath) -> IndexArray:
    """Index of each pixel's microlens, shape (rows, columns): centres project 1 + b_L/z times farther out."""
    edges = path.pixels.edges_x, path.pixels.edges_y
    x, y = ((edge[1:] + edge[:-1]) / 2 for edge in edges)
    seen = path.microlenses.centres * (1.0 + path.detector_distance / path.array_distance)
    pixels = np.stack(np.broadcast_arrays(x, y[:, None]), axis=-1)
    distance, index = cKDTree(seen).query(pixels, k=np.arange(1, 1 + min(_EQUALLY_NEAR, len(seen))))
    # A slight preference for the first, so that rounding does not decide for pixels midway between two.
    first = np.argmin(distance + 1e-9 * path.microlenses.pitch * index, axis=-1)
    return np.asarray(np.take_along_axis(index, first[..., None], axis=-1)[..., 0])


def _window(mine: BoolArray) -> tuple[slice, slice]:
    """Rows and columns of the smallest rectangle that contains all marked pixels."""
    rows, columns = (np.flatnonzero(mine.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def microlenses_alone(path: LightPath, indices: Sequence[int], owner: IndexArray) -> LightPath:
    """Light path of some microlenses, with the smallest rectangle around the pixels that they own."""
    window = _window(np.isin(owner, indices))
    return replace(path, microlenses=path.microlenses.only(*indices), pixels=path.pixels.part(*window))
