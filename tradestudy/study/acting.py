"""From the models that were chosen to cameras that they act in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Final

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.effects.base import OFF, SlotName
from tradestudy.imaging.derived_error import PictureDisparityError
from tradestudy.imaging.models import PictureModels

Models = Mapping[SlotName, str]

# What the picture calls it where a slot is off; the other models have one name.
_OFF_NAMES: Final = {
    "main_lens_diffraction": "none",
    "microlens_diffraction": "none",
    "pixel_integration": "point",
    "spectrum": "central",
}


def with_models(models: PictureModels, chosen: Models) -> PictureModels:
    """Models of a picture with those that are chosen in their slots."""
    slots = {field.name for field in fields(PictureModels)}
    names = {slot: _OFF_NAMES.get(slot, OFF) if name == OFF else name for slot, name in chosen.items() if slot in slots}
    return replace(models, **names)  # type: ignore[arg-type] # which names a slot has is the effects' concern


def in_closed_form(chosen: Models) -> dict[SlotName, str]:
    """The same models with Fresnel's transfer in place of Kirchhoff's, an integral that hardly differs from it."""
    return {slot: "fresnel" if name == "kirchhoff" else name for slot, name in chosen.items()}


def acting(camera: DepthCamera, chosen: Models) -> DepthCamera:
    """The camera with the chosen models in place of what it declares; nothing chosen leaves it as it is."""
    law = camera.disparity_error_px
    if isinstance(law, PictureDisparityError):
        camera = replace(camera, disparity_error_px=replace(law, models=with_models(law.models, chosen)))
    match chosen.get("calibration"):
        case "off" | "linear" | "exact" as model:
            return replace(camera, propagation=replace(camera.propagation, model=model))
        case _:
            return camera
