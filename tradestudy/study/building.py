"""Cameras built from their declarations in a study, with chosen models, and the keys of their posteriors."""

from __future__ import annotations

from dataclasses import fields, replace
from hashlib import sha256
from pathlib import Path
from typing import Final

from tradestudy.cameras.camera import Camera
from tradestudy.cameras.declaration import CameraDeclaration, DepthCameraDeclaration
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.effects import Models, SlotName
from tradestudy.imaging.models import Matcher, PictureModels, closed_form_models
from tradestudy.imaging.picture import PictureDisparityError
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.schema.scene import ScenePart

# Parts of a camera that affect no posterior: texts, measurement noise, and changes after the calibration.
_NOT_CALIBRATED: Final[dict[str, bool | set[str]]] = {
    "title": True,
    "note": True,
    "stated": True,
    "attributes": True,
    "depth": {"disparity_error", "error_of", "discrimination_step", "matcher"},
    "calibration": {"stability"},
    "sensor": {"quantum_efficiency", "temporal_dark_noise", "saturation_capacity", "system_gain"},
}


def camera_of(part: CameraDeclaration, scene: ScenePart | None, distance: FloatArray | None = None) -> Camera:
    """Build a declared camera, given the study's scene, and its distances [m] if they are known.

    Raises
    ------
    OutOfRangeError
        If no camera can have the declared values.
    """
    if not isinstance(part, DepthCameraDeclaration):
        return part.design(None)
    camera = part.design(_picture_law(scene, part))
    if scene is not None:  # refuse distances that it cannot measure
        camera.modelled_distance(scene.distance_values() if distance is None else distance)
    return camera


def posterior_key(name: str, part: DepthCameraDeclaration, *, seed: int, folder: Path) -> str:
    """Key of a camera's posterior, identical for all posteriors inferred from the same inputs in the same way.

    Parameters
    ----------
    name
        Name of the camera, on which its random numbers depend.
    part
        Its declaration.
    seed
        Seed of the study.
    folder
        Folder of the files that its calibration names.
    """
    inputs = (name, str(seed), str(folder), part.model_dump_json(exclude=_NOT_CALIBRATED))
    return sha256("\n".join(inputs).encode()).hexdigest()


def _picture_law(scene: ScenePart | None, part: DepthCameraDeclaration) -> PictureDisparityError | None:
    """The law of a derived disparity error; the camera's own matcher and sensor override those of the scene."""
    if scene is None or scene.picture is None or part.depth.declared_error_px is not None:
        return None
    own, settings = part.depth.matcher, scene.picture.settings(scene.wavelength, part.sensor.sensor())
    given = {
        key: value for part in (scene.picture.matcher, own) if part is not None for key, value in part.given().items()
    }
    return PictureDisparityError(
        settings=settings,
        models=closed_form_models(settings, microlenses=part.camera.pictured_by_microlenses),
        matcher=Matcher(**given),
    )


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
