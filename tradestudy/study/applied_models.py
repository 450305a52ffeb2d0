"""Apply chosen models to cameras."""

from __future__ import annotations

from dataclasses import fields, replace

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.effects.models import Models, SlotName
from tradestudy.imaging.models import PictureModels, closed_form_models
from tradestudy.imaging.picture import PictureDisparityError


def with_models(models: PictureModels, chosen: Models) -> PictureModels:
    """The models of a picture, with the chosen ones in place of those for the same effects."""
    slots = {field.name for field in fields(PictureModels)}
    own = {slot: name for slot, name in chosen.items() if slot in slots}
    return replace(models, **own)  # type: ignore[arg-type] # chosen models have the names that their effects list


def in_closed_form(chosen: Models) -> dict[SlotName, str]:
    """The same models, but Fresnel's transfer function instead of the almost equal integral of Kirchhoff's."""
    return {slot: "fresnel" if name == "kirchhoff" else name for slot, name in chosen.items()}


def complete_in_closed_form(camera: DepthCamera, law: PictureDisparityError) -> PictureModels:
    """The most complete closed-form models of a picture, even if its law leaves some out: Fresnel diffraction."""
    microlenses = camera.pictured_by_microlenses  # the law may leave out their diffraction
    plain = closed_form_models(law.settings, microlenses=microlenses)
    return replace(plain, main_lens_diffraction="fresnel", microlens_diffraction="fresnel" if microlenses else "off")


def apply_models(camera: DepthCamera, chosen: Models) -> DepthCamera:
    """The camera with the chosen models; effects without a chosen model keep the declared one."""
    law = camera.disparity_error_px
    if isinstance(law, PictureDisparityError):
        applied = with_models(law.models, chosen)
        if not law.settings.spectrum:  # a reading may remove it
            applied = replace(applied, spectrum="off")
        camera = replace(camera, disparity_error_px=replace(law, models=applied))
    match chosen.get("calibration"):
        case "off" | "linear" | "exact" as model:
            return replace(camera, propagation=replace(camera.propagation, model=model))
        case _:
            return camera
