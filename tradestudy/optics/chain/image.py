"""Image of a point, a disc or a spectrum through main lens and microlenses on the pixels, by a law for each leg.

`chain_image` adds the light of all microlenses; `separate_image` lets every pixel see only one, without cross-talk.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.arguments import check_wavelength, checked
from tradestudy.optics.arrays import BoolArray, FloatArray, IndexArray
from tradestudy.optics.chain.accuracy import ChainAccuracy, ChainImage, ComputeParts, in_turn, relative_change
from tradestudy.optics.chain.array_field import PupilWave
from tradestudy.optics.chain.arriving_light import point_wave
from tradestudy.optics.chain.behind_microlens import nearest_microlens
from tradestudy.optics.chain.exact_rays import exact_ray_image
from tradestudy.optics.chain.landing import geometric_image, landing_point_image, landing_spot_image
from tradestudy.optics.chain.point_image import wave_point_image
from tradestudy.optics.chain.scene import EXACT_RAYS, GEOMETRIC, Legs, LightPath
from tradestudy.optics.chain.sources import DiscSource, spectral_shares
from tradestudy.optics.chain.spot_image import wave_spot_image
from tradestudy.optics.propagation.lens import PointSource
from tradestudy.optics.propagation.sampling import refuse_near_zone
from tradestudy.optics.quadrature import disc_nodes

_SAME_FOCUS = 1e-6  # relative; a focus at exactly the image's distance was computed from it


def refuse_impossible(path: LightPath, source: PointSource | DiscSource, wavelength: float, legs: Legs) -> None:
    """Refuse wavelengths, sources and pupils that the laws of the legs do not cover.

    Raises
    ------
    OutOfRangeError
        If a law does not apply; the remedy names an alternative.
    """
    check_wavelength(wavelength)
    for width, distance in (
        (2 * path.main_lens.radius, path.array_distance),
        (path.microlenses.aperture_width, path.detector_distance),
    ):
        refuse_near_zone(width=width, nearest=distance, wavelength=wavelength)
    laws = f"{legs.to_array} to the array, {legs.to_detector} to the detector"
    integrals = {legs.to_array, legs.to_detector} <= {"fresnel", "kirchhoff"}
    coherent = isinstance(source, DiscSource) and source.coherent
    if coherent and not integrals:
        raise OutOfRangeError(
            "rays or boundary waves of a coherent disc",
            value=f"coherent, {laws}",
            limit="fresnel or kirchhoff on both legs",
            remedy="choose fresnel or kirchhoff, or an incoherent source",
        )
    if legs.to_detector == "boundary_wave" and path.microlenses.aperture != "circular":
        raise OutOfRangeError(
            "boundary wave behind the microlenses",
            value=f"{path.microlenses.aperture} apertures",
            limit="circular apertures",
            remedy="use kirchhoff to the detector, which is the same integral",
        )
    if path.pupils and not integrals:
        raise OutOfRangeError(
            "rays or boundary waves through lenses with a pupil",
            value=laws,
            limit="fresnel or kirchhoff on both legs",
            remedy="choose fresnel or kirchhoff, or leave the pupil out",
        )
    main = path.main_lens.pupil
    for lens, name in ((path.main_lens, "the main lens's pupil"), (path.microlenses.lens(0), "the microlenses' pupil")):
        if lens.pupil is None or lens.pupil.amplitude is None:
            continue
        nodes = disc_nodes(radius=lens.radius, radial_count=40, angular_count=80)
        if not np.any(np.square(lens.transmission(nodes.x, nodes.y))):
            raise OutOfRangeError(
                f"amplitude of {name}",
                value="0 all over the aperture",
                limit="light that passes",
                remedy="check the amplitude: images are fractions of the light through the main lens",
            )
    if isinstance(source, DiscSource) and not coherent and main is not None and not main.round:
        raise OutOfRangeError(
            "incoherent disc seen through a main-lens pupil",
            value="a pupil without rotational symmetry",
            limit="Zernike coefficients of azimuthal order 0, such as 4, 11 and 22",
            remedy="average images of points, or leave the other coefficients out",
        )


def refuse_following_microlenses(
    computed: ChainImage,
    path: LightPath,
    source: PointSource | DiscSource,
    legs: Legs,
    tolerance: float,
    image: Callable[[LightPath], ChainImage],
) -> None:
    """Refuse microlenses whose phase follows the source if fixed, parabolic ones give another image.

    No real microlens changes with the source. Near focus, where light meets only a part of it, a phase computed for the
    image of the source moves the light to that image.

    Parameters
    ----------
    computed
        The image of the path.
    path, source, legs
        Camera, source and methods of propagation.
    tolerance
        Largest relative L2 difference between the two images.
    image
        Function that computes the image of another path.

    Raises
    ------
    OutOfRangeError
        If the two images differ by more than the tolerance.
    """
    if phase_follows_source(path, source, legs):
        refuse_change_by_phase(path, relative_change(computed.pixels, image(with_fixed_phase(path)).pixels), tolerance)


def with_fixed_phase(path: LightPath) -> LightPath:
    """The path with parabolic microlenses, whose phase is the same for every source."""
    return replace(path, microlenses=replace(path.microlenses, lens_phase="parabolic", focus_distance=None))


def refuse_change_by_phase(
    path: LightPath, change: float, tolerance: float, tolerance_name: str = "the tolerance of the image"
) -> None:
    """Refuse microlenses whose image differs from that of fixed ones by a change (relative L2) above the tolerance."""
    if change > tolerance:
        raise OutOfRangeError(
            f"{path.microlenses.lens_phase} microlenses, whose phase follows the source",
            value=f"an image that differs by about {change:.2g} from that of parabolic microlenses, which are fixed",
            limit=f"a difference ≤ {tolerance:g}, {tolerance_name}",
            remedy="use the parabolic lens phase for the microlenses, with a pupil for their aberrations",
        )


def phase_follows_source(path: LightPath, source: PointSource | DiscSource, legs: Legs) -> bool:
    """Whether the phase of the microlenses, as far as the second leg uses it, is computed for this source."""
    waves = legs.to_detector in ("kirchhoff", "boundary_wave")  # for paraxial rays and Fresnel, all phases are the same
    if path.microlenses.lens_phase == "perfect":
        return waves  # exact rays bend by x/f wherever they come from
    focus = path.microlenses.focus_distance
    if focus is None or not (waves or legs.exact):
        return False
    middle = source.centre if isinstance(source, DiscSource) else source
    return math.isclose(focus, path.image_at_array(middle)[2], rel_tol=_SAME_FOCUS)


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
    """Image of a point or a disc on the pixels behind a main lens and a microlens array.

    U(σ) = Σ_k ∬ T_k(x) K_d(x, σ) [∬ W(u) K_a(u, x) du] dx is the field at a point σ of the detector. It is a sum over
    the microlenses k, whose light therefore interferes. W is the wave behind the main lens at a point u of its pupil,
    K_a the kernel that propagates this wave to a point x of the array, T_k the amplitude and phase of microlens k, and
    K_d the kernel from x to σ. |U|² is integrated over each pixel and divided by the power through the pupil.

    Parameters
    ----------
    path
        Main lens, microlenses, the distances between them and the detector, and the pixels.
    source
        A `PointSource` or a `DiscSource`. The intensities of the points of an incoherent disc add up; a coherent disc
        emits one wave, with the same phase at every point.
    wavelength
        Wavelength λ [m], > 0.
    legs
        Methods of propagation on the two legs, from the main lens to the array and from the array to the detector. A
        coherent disc, or a lens with a `Pupil`, needs ``fresnel`` or ``kirchhoff`` on both. In three
        cases, the light is treated as follows:

        * Rays to the array, waves behind it: each microlens receives a spherical wave that is centred on the image
          formed by the main lens and ends at the geometric shadow of the pupil.
        * Waves to the array, rays behind it: the light at each point of the array travels to one point of the detector.
          Light from different points of the array does not interfere there.
        * Boundary wave behind the array: the wave behind each microlens is split into the spherical wave that fits it
          best and the rest. The boundary-wave method propagates the spherical wave, Kirchhoff's integral the rest.
    accuracy
        Tolerance of the image, factors that refine its sampling, and the memory allowed.
    rng
        Random generator that chooses the points at which the result is checked against direct quadrature.
    done
        Function called, for an incoherent disc, with the completed fraction of the propagation behind the array.
    compute
        Function ``compute(parts, progress)``. It calls each of the functions in the list ``parts``, returns their
        results in order, and calls ``progress`` with the completed fraction. Each part computes the light from some
        points of an incoherent disc, and may run in any process. Default: one part after another in this process.

    Returns
    -------
    ChainImage
        Fraction of the power through the pupil on each pixel, with its numerical error. An image whose error exceeds
        the tolerance is returned with ``within_tolerance`` False; `microlens_image` refines the sampling instead.

    Raises
    ------
    OutOfRangeError
        The wavelength exceeds an aperture or a distance; rays or a boundary wave are combined with a coherent disc or
        with a `Pupil`; a boundary wave to the detector is combined with square microlenses; an incoherent disc is
        combined with a main-lens pupil that is not rotationally symmetric; only one leg uses rays while the image of
        the source lies on the array or close to it; or the phase of the microlenses follows the source (``perfect``, or
        ``stigmatic`` with its focus at the main lens's image) and the image differs from that of ``parabolic``
        microlenses by more than the tolerance.
    UnaffordableError
        The computation needs more memory than ``accuracy`` allows, or would divide the source into more
        than about a million points.
    NotConvergedError
        The result differs from direct quadrature by so much that the sampling must be wrong, or Kirchhoff's integral
        misses the tolerance at points where a boundary wave does not apply.

    References
    ----------
    "Diffraction model of a plenoptic camera for in-situ space exploration", eqs. 14, 16, 22 and 25, with one
    correction: in the path from the main lens to the array, eqs. 23–26 need array coordinates measured from the axis of
    the main lens, not from the centre of a microlens.

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
    image = partial(
        unguarded_image, source=source, wavelength=wavelength, legs=legs, accuracy=accuracy, rng=rng, compute=compute
    )
    computed = image(path, done=done)
    refuse_following_microlenses(computed, path, source, legs, accuracy.tolerance, image)
    return computed


def unguarded_image(
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
    """Image by the laws of the legs, as `chain_image`, whatever the phase of the microlenses follows.

    For loops over tolerances, which call `refuse_following_microlenses` once, with the tolerance that was asked for.
    """
    image = _by_laws(path, source, wavelength, legs, accuracy, rng, done, compute)
    return replace(image, tolerance=accuracy.tolerance, path=path)


def _by_laws(
    path: LightPath,
    source: PointSource | DiscSource,
    wavelength: float,
    legs: Legs,
    accuracy: ChainAccuracy,
    rng: np.random.Generator,
    done: Callable[[float], None],
    compute: ComputeParts,
) -> ChainImage:
    """Image without its tolerance."""
    refuse_impossible(path, source, wavelength, legs)
    needed = 16.0 * math.prod(path.pixels.shape)  # an image, and another for its error
    if needed > accuracy.memory_limit:
        raise UnaffordableError(
            "pixels of the detector",
            value=f"{path.pixels.shape[0]} × {path.pixels.shape[1]}, {needed / 1e9:.3g} GB",
            limit=f"{accuracy.memory_limit / 1e9:.3g} GB",
            remedy="use fewer pixels, or raise the memory limit",
        )
    coherent = isinstance(source, DiscSource) and source.coherent
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
    # What is left emits one wave: a point, or a coherent disc.
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
    """Image formed by several wavelengths: the weighted mean of the images that `chain_image` computes for each.

    Parameters
    ----------
    path, source, legs, accuracy, rng
        As in `chain_image`.
    wavelengths
        Wavelengths λ [m], > 0, shape (n,).
    weights
        Power through the pupil at each wavelength [any unit], ≥ 0, not all zero, shape (n,); only the ratios matter.

    Returns
    -------
    ChainImage
        Fraction of the power through the pupil on each pixel. Its error is the weighted sum of the errors at the
        individual wavelengths.

    Raises
    ------
    OutOfRangeError
        The shapes of wavelengths and weights differ, a weight is negative or not finite, all weights are zero, or
        `chain_image` refuses an argument.
    UnaffordableError, NotConvergedError
        `chain_image` fails at one of the wavelengths.

    References
    ----------
    Light of different wavelengths does not interfere: M. Born and E. Wolf, *Principles of Optics*, section 7.5.8.

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
        path=max((part.path for part in parts if part.path), key=lambda path: path.microlenses.count, default=None),
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
    """Image without cross-talk: every pixel receives only light from the microlens to which it belongs.

    A pixel belongs to the microlens whose centre, projected from the centre of the main lens onto the detector, is
    nearest to the pixel. Light that a microlens sends to pixels of its neighbours is discarded.

    Parameters
    ----------
    path, source, wavelength, legs, accuracy, rng
        As in `chain_image`.
    done
        Function called after each microlens with the fraction of microlenses completed.
    compute
        As in `chain_image`, but each part computes the light from one microlens.

    Returns
    -------
    ChainImage
        Fraction of the power through the pupil on each pixel. The errors of the individual microlenses are added in
        quadrature.

    Raises
    ------
    OutOfRangeError, UnaffordableError, NotConvergedError
        `chain_image` refuses an argument or fails for one of the microlenses.

    References
    ----------
    The image that `chain_image` computes for each microlens alone, on the pixels that belong to it.

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
    >>> print(f"{image.pixels.sum():.2f} of the light on the pixels of its own microlens")
    0.82 of the light on the pixels of its own microlens
    """
    image = partial(
        unguarded_separate_image,
        source=source,
        wavelength=wavelength,
        legs=legs,
        accuracy=accuracy,
        rng=rng,
        compute=compute,
    )
    computed = image(path, done=done)
    refuse_following_microlenses(computed, path, source, legs, accuracy.tolerance, image)
    return computed


def unguarded_separate_image(
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
    """Image without cross-talk, as `separate_image`; see `unguarded_image`."""
    owner = nearest_microlens(path)
    present = np.unique(owner)
    seeds = rng.integers(
        2**63, size=present.size
    )  # one for each microlens, so that the place of computation does not matter
    images: list[ChainImage] = compute(
        [
            partial(_alone, microlenses_alone(path, [index], owner), source, wavelength, legs, accuracy, seed)
            for index, seed in zip(present.tolist(), seeds.tolist(), strict=True)
        ],
        done,
    )
    pixels = np.zeros(owner.shape)
    for index, alone in zip(present, images, strict=True):
        mine = owner == index
        pixels[_window(mine)] += np.where(mine[_window(mine)], alone.pixels, 0.0)
    errors = [image.numerical_error * float(np.linalg.norm(image.pixels)) for image in images]
    size = float(np.linalg.norm(pixels))
    error = math.hypot(*errors) / size if size > 0.0 else 0.0
    return ChainImage(
        pixels=pixels,
        numerical_error=error,
        error_terms={"microlenses alone": error},
        direct_check={name: max(image.direct_check[name] for image in images) for name in images[0].direct_check},
        microlens_share=math.fsum(image.microlens_share for image in images),
        effort={name: sum(image.effort[name] for image in images) for name in images[0].effort},
        handed_over=max(image.handed_over for image in images),
        tolerance=accuracy.tolerance,
        path=path,
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
    return unguarded_image(path, source, wavelength=wavelength, legs=legs, accuracy=accuracy, rng=rng)


def _window(mine: BoolArray) -> tuple[slice, slice]:
    """Rows and columns of the smallest rectangle that contains all marked pixels."""
    rows, columns = (np.flatnonzero(mine.any(axis=axis)) for axis in (1, 0))
    return slice(rows[0], rows[-1] + 1), slice(columns[0], columns[-1] + 1)


def microlenses_alone(path: LightPath, indices: Sequence[int], owner: IndexArray) -> LightPath:
    """Light path of some microlenses, with the smallest rectangle around the pixels that they own."""
    window = _window(np.isin(owner, indices))
    return replace(path, microlenses=path.microlenses.only(*indices), pixels=path.pixels.part(*window))
