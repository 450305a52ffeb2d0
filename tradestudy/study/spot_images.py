"""Images of a light spot as studies ask for them, each computed once."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final

import numpy as np

from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.chain import (
    FRESNEL,
    GEOMETRIC,
    KIRCHHOFF,
    KIRCHHOFF_FRESNEL,
    ChainAccuracy,
    ChainImage,
    DiscSource,
    Legs,
    LightPath,
    Microlenses,
    PixelGrid,
    chain_image,
    separate_image,
    square_centres,
)
from tradestudy.optics.propagation import CircularLens
from tradestudy.study.schema.wave_optics import LightSpotPart, MethodName

LEGS: Final[Mapping[MethodName, Legs]] = {
    "geometric": GEOMETRIC,
    "fresnel": FRESNEL,
    "kirchhoff-fresnel": KIRCHHOFF_FRESNEL,
    "kirchhoff": KIRCHHOFF,
}


def light_path(part: LightSpotPart) -> LightPath:
    """Main lens, microlenses and pixels as declared; stigmatic lenses are made for the spot."""
    lens, array = part.main_lens, part.microlenses
    image = lens.focal_length * part.spot.distance / (part.spot.distance - lens.focal_length)
    return LightPath(
        main_lens=CircularLens(
            radius=lens.focal_length / lens.f_number / 2,
            focal_length=lens.focal_length,
            lens_phase=lens.lens_phase,
            focus_distance=part.spot.distance if lens.lens_phase == "stigmatic" else None,
        ),
        microlenses=Microlenses(
            centres=square_centres(pitch=array.pitch, count=array.across),
            focal_lengths=np.full(array.across**2, array.focal_length),
            aperture="circular",
            aperture_width=array.focal_length / array.f_number,
            pitch=array.pitch,
            layout="square",
            gaps=array.gaps,
            lens_phase=array.lens_phase,
            focus_distance=part.array_distance - image if array.lens_phase == "stigmatic" else None,
        ),
        array_distance=part.array_distance,
        detector_distance=array.gap,
        pixels=PixelGrid(pitch=part.detector.pixel_pitch, shape=(part.detector.pixels, part.detector.pixels)),
    )


def light_source(part: LightSpotPart) -> DiscSource:
    """The spot as declared."""
    return DiscSource(diameter=part.spot.diameter, distance=part.spot.distance, x=part.spot.x, y=part.spot.y)


@dataclass(frozen=True, kw_only=True)
class SpotModels:
    """What makes a picture of the spot.

    Parameters
    ----------
    method
        Laws of both legs.
    tolerance
        Relative numerical error that is aimed at.
    separate
        Every pixel takes the light of its own microlens alone.
    integrated
        Pixels integrate; else they take their centres' light times their area.
    point
        All light comes from the middle of the spot.
    """

    method: MethodName
    tolerance: float
    separate: bool = False
    integrated: bool = True
    point: bool = False


def spot_image(part: LightSpotPart, method: MethodName) -> ChainImage:
    """Image of the declared spot by one of the methods that are compared, with nothing else left out."""
    return spot_picture(part, SpotModels(method=method, tolerance=part.tolerance))


def spot_picture(part: LightSpotPart, models: SpotModels) -> ChainImage:
    """Image of the declared spot by any models; what does not touch the image does not compute it again."""
    return _spot_picture(without_comparison(part), models)


def without_comparison(part: LightSpotPart) -> LightSpotPart:
    """What touches the image of a spot: the part without the methods that are compared, and to what."""
    return part.model_copy(update={"methods": (), "tolerance": 1.0, "published": (), "benchmarks": False})


@lru_cache(maxsize=64)
def _spot_picture(part: LightSpotPart, models: SpotModels) -> ChainImage:
    path, source = light_path(part), light_source(part)
    image_of = separate_image if models.separate else chain_image
    return image_of(
        replace(path, pixels=replace(path.pixels, integrated=models.integrated)),
        source.centre if models.point else source,
        wavelength=part.wavelength,
        legs=LEGS[models.method],
        accuracy=ChainAccuracy(tolerance=models.tolerance),
        rng=np.random.default_rng(part.seed),
    )


def image_difference(image: FloatArray, reference: FloatArray) -> float:
    """Sum of absolute differences over the sum of the reference."""
    return float(np.sum(np.abs(image - reference)) / np.sum(reference))


def lit_pixels(image: FloatArray, above: float) -> int:
    """Number of pixels that hold more than a share of the brightest pixel's light."""
    return int(np.sum(image > above * image.max()))
