"""Refuse what the laws of the chain, or the shortcuts of its computation, do not cover."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.optics.arguments import check_wavelength
from tradestudy.optics.chain.accuracy import ChainImage, relative_change
from tradestudy.optics.chain.scene import Legs, LightPath, PixelGrid
from tradestudy.optics.chain.sources import DiscSource
from tradestudy.optics.propagation.lens import CircularLens, PointSource
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
    if path.pupils and not integrals:
        raise OutOfRangeError(
            "rays or boundary waves through lenses with a pupil",
            value=laws,
            limit="fresnel or kirchhoff on both legs",
            remedy="choose fresnel or kirchhoff, or leave the pupil out",
        )
    main = path.main_lens.pupil
    for lens, name in ((path.main_lens, "the main lens's pupil"), (path.microlenses.lens(0), "the microlenses' pupil")):
        if lens.pupil is not None and lens.pupil.amplitude is not None and not _passes_light(lens):
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


def _passes_light(lens: CircularLens) -> bool:
    """Whether the pupil's amplitude differs from 0 somewhere on the aperture."""
    nodes = disc_nodes(radius=lens.radius, radial_count=40, angular_count=80)
    return bool(np.any(np.square(lens.transmission(nodes.x, nodes.y))))


def refuse_vast_detector(pixels: PixelGrid, memory_limit: float) -> None:
    """Refuse more pixels than memory [bytes] holds twice: in an image, and in another for its error.

    Raises
    ------
    UnaffordableError
        If there are more.
    """
    needed = 16.0 * math.prod(pixels.shape)
    if needed > memory_limit:
        raise UnaffordableError(
            "pixels of the detector",
            value=f"{pixels.shape[0]} × {pixels.shape[1]}, {needed / 1e9:.3g} GB",
            limit=f"{memory_limit / 1e9:.3g} GB",
            remedy="use fewer pixels, or raise the memory limit",
        )


def refuse_following_microlenses(
    found: ChainImage,
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
    found
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
    lenses = path.microlenses
    if not _follows(path, source, legs):
        return
    fixed = replace(path, microlenses=replace(lenses, lens_phase="parabolic", focus_distance=None))
    change = relative_change(found.pixels, image(fixed).pixels)
    if change > tolerance:
        raise OutOfRangeError(
            f"{lenses.lens_phase} microlenses, whose phase follows the source",
            value=f"an image that differs by {change:.2g} from that of parabolic microlenses, which are fixed",
            limit=f"a difference ≤ {tolerance:g}, the tolerance of the image",
            remedy="use the parabolic lens phase for the microlenses, with a pupil for their aberrations",
        )


def _follows(path: LightPath, source: PointSource | DiscSource, legs: Legs) -> bool:
    """Whether the phase of the microlenses, as far as the second leg uses it, is computed for this source."""
    waves = legs.to_detector in ("kirchhoff", "boundary_wave")  # for paraxial rays and Fresnel, all phases are the same
    if path.microlenses.lens_phase == "perfect":
        return waves  # exact rays bend by x/f wherever they come from
    focus = path.microlenses.focus_distance
    if focus is None or not (waves or legs.exact):
        return False
    middle = source.centre if isinstance(source, DiscSource) else source
    return math.isclose(focus, path.image_at_array(middle)[2], rel_tol=_SAME_FOCUS)
