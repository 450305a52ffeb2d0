"""The picture of a light spot: which laws, which omissions and which sampling its pixels call for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Final

import numpy as np

from tradestudy.effects.base import OFF, SlotName
from tradestudy.effects.crosstalk import crosstalk_in_picture
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.main_lens_diffraction import main_lens_diffraction_in_picture
from tradestudy.effects.microlens_diffraction import microlens_diffraction_in_picture
from tradestudy.effects.pixel_integration import pixel_integration_in_picture
from tradestudy.effects.sampling import sampling, tolerance_of
from tradestudy.effects.selection import Chosen, Selection
from tradestudy.effects.source_extent import source_extent_in_picture
from tradestudy.effects.spectrum import spectrum_in_picture
from tradestudy.study.schema.wave_optics import LightSpotPart, MethodName
from tradestudy.study.situations.light_cost import LightWork, seconds_of_rays
from tradestudy.study.situations.situation import Situation
from tradestudy.study.spot_images import SpotModels, light_path, light_source

NAME: Final = "light-spot"
METHODS: Final[dict[tuple[str, str], MethodName]] = {
    (OFF, OFF): "geometric",
    ("fresnel", "fresnel"): "fresnel",
    ("kirchhoff", "fresnel"): "kirchhoff-fresnel",
    ("kirchhoff", "kirchhoff"): "kirchhoff",
}


def light_spot_situation(part: LightSpotPart) -> Situation:
    """The models that could make the picture of a declared spot; costs are those of the reference machine.

    Rays on one leg and waves on the other cannot be combined, nor rays with samples at the middle of pixels; Fresnel
    before Kirchhoff would spare nothing and is not offered.
    """
    scene = LightScene(path=light_path(part), source=light_source(part), wavelength=part.wavelength)
    works = cache(lambda tolerance: LightWork(scene=scene, tolerance=tolerance))

    def seconds(chosen: Chosen) -> float:
        models = _models(chosen)
        if models is None:
            return math.inf
        if models.method == "geometric":
            return seconds_of_rays(scene.path, point=models.point) if models.integrated else math.inf
        work, paraxial = works(models.tolerance), models.method == "fresnel"
        if models.point:
            return work.seconds_of_point(paraxial=paraxial)
        return work.seconds_of_disc(paraxial=paraxial, separate=models.separate)

    return Situation(
        name=NAME,
        title="Picture of the light spot",
        quantities=("pixel_intensity",),
        slots=(
            main_lens_diffraction_in_picture(scene),
            microlens_diffraction_in_picture(scene),
            crosstalk_in_picture(scene),
            pixel_integration_in_picture(scene),
            source_extent_in_picture(scene),
            spectrum_in_picture(scene, wavelengths=np.array([part.wavelength]), weights=np.ones(1)),
            sampling("pixel_intensity"),
        ),
        seconds=seconds,
    )


def spot_models(selection: Selection) -> SpotModels:
    """What a selection of models computes."""
    models = _models(selection.chosen)
    assert models is not None  # a set that cannot be combined costs infinitely much and is never selected
    return models


def named_spot_models(part: LightSpotPart, names: Mapping[SlotName, str]) -> SpotModels:
    """What models of such names compute, one for every slot."""
    models = _models({slot.name: slot.model(names[slot.name]) for slot in light_spot_situation(part).slots})
    assert models is not None  # as above
    return models


def _models(chosen: Chosen) -> SpotModels | None:
    """None for laws that cannot be combined."""
    method = METHODS.get((chosen["main_lens_diffraction"].name, chosen["microlens_diffraction"].name))
    if method is None:
        return None
    return SpotModels(
        method=method,
        separate=chosen["crosstalk"].name == OFF,
        integrated=chosen["pixel_integration"].name != OFF,
        point=chosen["source_extent"].name == OFF,
        tolerance=tolerance_of(chosen["sampling"]),
    )
