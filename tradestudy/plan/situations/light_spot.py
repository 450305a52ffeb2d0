"""The picture of a light spot: which laws, which omissions and which sampling its pixels call for."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np

from tradestudy.analysis.spot_images import RAYS, SpotModels, legs, light_path, light_source, without_comparison
from tradestudy.effects.base import COMPLETE, OFF, Model, Slot, SlotName
from tradestudy.effects.light_scene import LightScene
from tradestudy.effects.light_slots import (
    crosstalk_in_picture,
    main_lens_diffraction_in_picture,
    microlens_diffraction_in_picture,
    pixel_integration_in_picture,
    sampling,
    source_extent_in_picture,
    spectrum_in_picture,
    tolerance_of,
)
from tradestudy.effects.selection import Chosen, Selection
from tradestudy.errors import UnaffordableError
from tradestudy.optics.chain import DiscSource
from tradestudy.optics.propagation import PointSource
from tradestudy.plan.situations.light_cost import SECONDS_PER_NODE, LightWork, pupil_nodes, seconds_of_rays
from tradestudy.plan.situations.situation import Situation
from tradestudy.study.schema.light_spot import LightSpotPart, MethodName

NAME: Final = "light-spot"
_POINT: Final = Slot(name="source_extent", models=(Model(name=OFF, bounds={"pixel_intensity": COMPLETE}),))
_POINT_DIAMETER: Final = 1e-12  # far below every wavelength; no bound divides by it
# Mixtures with rays are for comparisons: beside waves rays are paraxial, and no bound of a slot alone holds for them.
METHODS: Final[dict[tuple[str, str], MethodName]] = {
    (OFF, OFF): "exact-rays",
    ("boundary_wave", "boundary_wave"): "boundary-wave",
    ("boundary_wave", "fresnel"): "boundary-wave-fresnel",
    ("boundary_wave", "kirchhoff"): "boundary-wave-kirchhoff",
    ("fresnel", "fresnel"): "fresnel",
    ("kirchhoff", "boundary_wave"): "kirchhoff-boundary-wave",
    ("kirchhoff", "fresnel"): "kirchhoff-fresnel",
    ("kirchhoff", "kirchhoff"): "kirchhoff",
}


def light_spot_situation(part: LightSpotPart) -> Situation:
    """The models that could make the picture of a declared spot; costs are those of the reference machine.

    Rays on one leg and waves on the other cannot be combined, nor rays with samples at the middle of pixels or with a
    coherent disc; Fresnel before Kirchhoff would spare nothing and is not offered.
    """
    scene = light_scene(part)

    def seconds(chosen: Chosen) -> float:
        models = _models(chosen)
        if models is None or (models.method in RAYS and not models.integrated):
            return math.inf
        return picture_seconds(part, models)

    refused = (OFF, "boundary_wave") if part.spot.coherent else ()
    diffraction = [
        replace(slot, models=tuple(model for model in slot.models if model.name not in refused))
        for slot in (main_lens_diffraction_in_picture(scene), microlens_diffraction_in_picture(scene))
    ]
    return Situation(
        name=NAME,
        title="Picture of the light spot",
        quantities=("pixel_intensity",),
        slots=(
            *diffraction,
            crosstalk_in_picture(scene),
            pixel_integration_in_picture(scene),
            _POINT if part.spot.is_point else source_extent_in_picture(scene),
            spectrum_in_picture(
                scene,
                wavelengths=np.array([wavelength for wavelength, _ in part.lines]),
                weights=np.array([share for _, share in part.lines]),
            ),
            sampling(),
        ),
        seconds=seconds,
    )


@lru_cache(maxsize=16)
def light_scene(part: LightSpotPart) -> LightScene:
    """What bounds and costs follow from, in light of the mean wavelength; a point is the limit of small discs."""
    source = light_source(part)
    if isinstance(source, PointSource):
        source = DiscSource(diameter=_POINT_DIAMETER, distance=source.distance, x=source.x, y=source.y)
    return LightScene(path=light_path(part), source=source, wavelength=part.mean_wavelength)


def picture_seconds(part: LightSpotPart, models: SpotModels) -> float:
    """Seconds of a picture of the spot on the reference machine; the tolerance is nothing to paraxial rays."""
    work = _work(without_comparison(part), models.tolerance)
    if models.method == "geometric":
        return seconds_of_rays(work.scene.path, point=models.point)
    if models.method == "exact-rays":
        return work.seconds_of_exact_rays(point=models.point)
    wavelengths = 1 if models.monochromatic else len(part.lines)
    try:
        return wavelengths * _seconds_of_waves(part, models, work)
    except UnaffordableError:
        return math.inf


def _seconds_of_waves(part: LightSpotPart, models: SpotModels, work: LightWork) -> float:
    """Seconds of a picture by waves in light of one wavelength."""
    laws = legs(models.method)
    if models.point:
        return work.seconds_of_point(laws=laws)
    if part.spot.coherent:
        repeats = work.scene.path.microlenses.count if models.separate else 1  # on the pupil, for each microlens anew
        wave = SECONDS_PER_NODE["fresnel" if laws.to_array == "fresnel" else "kirchhoff"] * pupil_nodes(work.scene)
        return work.seconds_of_point(laws=laws) + repeats * wave
    return work.seconds_of_disc(laws=laws, separate=models.separate)


@lru_cache(maxsize=64)
def _work(part: LightSpotPart, tolerance: float) -> LightWork:
    return LightWork(scene=light_scene(part), tolerance=tolerance)


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
        monochromatic=chosen["spectrum"].name == OFF,
        tolerance=tolerance_of(chosen["sampling"]),
    )
