"""From the parts of a study file to cameras, pictures and criteria in SI floats."""

from __future__ import annotations

from dataclasses import replace

from tradestudy.cameras.camera import Camera
from tradestudy.cameras.declaration import CameraDeclaration, DepthCameraDeclaration
from tradestudy.cameras.depth_camera import UsableCriteria
from tradestudy.cameras.focus import BlurCriterion
from tradestudy.imaging.derived_error import PictureDisparityError
from tradestudy.imaging.light import Light, SensorNoise
from tradestudy.imaging.models import PictureModels, PictureSettings, Texture
from tradestudy.study.schema.depth_of_field import BlurPart
from tradestudy.study.schema.picture import PicturePart
from tradestudy.study.schema.questions import UsablePart
from tradestudy.study.schema.scene import ScenePart


def camera_of(part: CameraDeclaration, scene: ScenePart | None) -> Camera:
    """Build the camera that a part of a study declares, in the light and the temperature of its scene.

    Raises
    ------
    OutOfRangeError
        Where the parts do not make a camera.
    """
    if not isinstance(part, DepthCameraDeclaration):
        return part.design(None)
    camera = part.design(_picture_law(scene, microlenses=part.pictured_by_microlenses))
    if scene is None or scene.temperature is None:
        return camera
    own = scene.temperature.expansion if part.thermal_expansion is None else part.thermal_expansion
    return replace(camera, expansion=abs(own) * scene.temperature.deviation)


def _picture_law(scene: ScenePart | None, *, microlenses: bool) -> PictureDisparityError | None:
    """What a derived disparity error follows; None without a picture."""
    if scene is None or scene.picture is None:
        return None
    settings = picture_of(scene.picture, scene.wavelength)
    return PictureDisparityError(settings=settings, models=closed_form_models(settings, microlenses=microlenses))


def picture_of(part: PicturePart, wavelength: float) -> PictureSettings:
    """Texture, light, sensor and window in SI; ``wavelength`` [m] is the central one."""
    window = part.window
    return PictureSettings(
        texture=Texture(contrast=part.texture.contrast, correlation_length=part.texture.correlation_length),
        light=Light(
            electrons=part.light.electrons, f_number=part.light.at_f_number, pixel_pitch=part.light.at_pixel_pitch
        ),
        sensor_noise=SensorNoise(
            read_noise_electrons=part.read_noise, full_well_electrons=part.full_well, bits=part.bits
        ),
        wavelength=wavelength,
        window_px=window.size if window.of == "picture" else None,
        window_length=window.size if window.of == "object" else None,
        spectrum=tuple((line.wavelength, line.weight) for line in part.spectrum or ()),
        field_angle=part.field_angle,
        stop_separation=part.stop_separation,
        pixel_fill=part.pixel_fill,
        lens_phase=part.lens_phase,
    )


def closed_form_models(picture: PictureSettings, *, microlenses: bool) -> PictureModels:
    """Every effect of the picture that has a closed form: what a derived error is made of unless models are chosen.

    ``microlenses`` says whether the camera's picture comes through microlenses that blur it.
    """
    return PictureModels(
        defocus_blur="disc",
        main_lens_diffraction="airy",
        microlens_diffraction="airy" if microlenses else "none",
        crosstalk="share" if microlenses else "off",
        pixel_integration="square",
        spectrum="weighted" if picture.spectrum else "central",
        vignetting="cos4",
        sensor_noise="shot+read+quantisation",
    )


def criteria_of(part: UsablePart) -> UsableCriteria:
    """The limits of the usable range."""
    return UsableCriteria(
        overlap=part.overlap,
        availability=part.availability,
        virtual_depth=part.virtual_depth,
        blur_px=part.blur,
        disparity_step_px=part.disparity_step,
        failed_fraction=part.failed_fraction,
        relative_uncertainty=part.relative_uncertainty,
    )


def blur_criterion_of(part: BlurPart, wavelength: float) -> BlurCriterion:
    """What counts as sharp, in the light of the scene."""
    return BlurCriterion(blur_px=part.blur, measure=part.diffraction, wavelength=wavelength)
