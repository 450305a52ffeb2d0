"""From the parts of a study file to cameras and criteria in SI floats."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import assert_never

from tradestudy.cameras.conventional import ConventionalCamera, FocusStackPlan
from tradestudy.cameras.depth_camera import DisparityError, ErrorSource, UsableCriteria
from tradestudy.cameras.focus import BlurCriterion
from tradestudy.cameras.focused_plenoptic import FocusedPlenoptic
from tradestudy.cameras.parts import Lens, MicrolensArray, Sensor, focal_length_of_field_of_view
from tradestudy.cameras.plenoptic_calibration import PlenopticCalibration
from tradestudy.cameras.stereo import StereoCalibration, StereoRig
from tradestudy.cameras.unfocused_plenoptic import UnfocusedPlenoptic
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.derived_error import PictureDisparityError
from tradestudy.imaging.models import PictureModels, PictureSettings
from tradestudy.imaging.noise import Light, SensorNoise
from tradestudy.imaging.texture import Texture
from tradestudy.optics.depth_of_field import (
    microlens_focal_length,
    object_distance_of_magnification,
    object_distance_of_working_distance,
    touching_inverse_virtual_depths,
)
from tradestudy.optics.thin_lens import image_distance
from tradestudy.study.schema.cameras import (
    AngleErrorPart,
    CameraPart,
    ConventionalFocusPart,
    ConventionalPart,
    DisparityPart,
    FocusedPlenopticPart,
    LengthErrorPart,
    LensPart,
    NormalLengthErrorPart,
    PlenopticCalibrationPart,
    SensorPart,
    StereoPart,
    UnfocusedPlenopticPart,
)
from tradestudy.study.schema.depth_of_field import BlurPart
from tradestudy.study.schema.picture import PicturePart
from tradestudy.study.schema.questions import UsablePart
from tradestudy.study.schema.scene import TemperaturePart

COVERING_VIRTUAL_DEPTH = 2.0
AnyCamera = FocusedPlenoptic | UnfocusedPlenoptic | StereoRig | ConventionalCamera


def camera_of(part: CameraPart, picture: PictureSettings | None) -> AnyCamera:
    """Build the camera that a part of a study file describes.

    Parameters
    ----------
    part
        As written.
    picture
        What a derived disparity error follows from; None in a study that has none.

    Raises
    ------
    OutOfRangeError
        Where the parts do not make a camera.
    """
    match part:
        case FocusedPlenopticPart():
            return focused_plenoptic_of(part, picture)
        case UnfocusedPlenopticPart():
            return unfocused_plenoptic_of(part, picture)
        case StereoPart():
            return stereo_of(part, picture)
        case ConventionalPart():
            return conventional_of(part)
        case _:
            assert_never(part)


def with_expansion(camera: AnyCamera, part: CameraPart, temperature: TemperaturePart | None) -> AnyCamera:
    """The camera with what the temperature of the scene does to the length that its depth rests on."""
    if temperature is None or isinstance(camera, ConventionalCamera) or isinstance(part, ConventionalPart):
        return camera
    own = temperature.expansion if part.thermal_expansion is None else part.thermal_expansion
    return replace(camera, expansion=abs(own) * temperature.deviation)


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


def disparity_error_of(
    part: DisparityPart, picture: PictureSettings | None, *, microlenses: bool = False
) -> DisparityError:
    """The declared error of a disparity [px], or the law of its picture.

    Raises
    ------
    OutOfRangeError
        A derived error without a picture to derive it from.
    """
    declared = part.declared_error_px
    if declared is not None:
        return declared
    if picture is None:
        raise OutOfRangeError(
            "a derived disparity error needs the scene's picture", remedy="add picture to scene: texture, light, sensor"
        )
    return PictureDisparityError(settings=picture, models=closed_form_models(picture, microlenses=microlenses))


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


def stereo_of(part: StereoPart, picture: PictureSettings | None) -> StereoRig:
    """A stereo rig; axes that meet at Z₀ converge by ``2 atan(B / 2Z₀)``."""
    sensor = sensor_of(part.sensor)
    errors = part.calibration
    return StereoRig(
        lens=lens_of(part.lenses, sensor),
        sensor=sensor,
        focus_distance=None if part.focus_distance == "every-object" else part.focus_distance,
        principal_distance_rule=part.principal_distance,
        baseline=part.baseline,
        convergence_angle=2.0 * math.atan(part.baseline / (2.0 * part.axes_meet_at)),
        triangulation=part.depth.estimator,
        disparity_error_px=disparity_error_of(part.depth, picture),
        discrimination_step_px=part.depth.discrimination_step,
        calibration=StereoCalibration(
            yaw=error_of(errors.yaw),
            pitch=error_of(errors.pitch),
            roll=error_of(errors.roll),
            baseline=error_of(errors.baseline),
            focal_length=error_of(errors.focal_length),
            principal_point=error_of(errors.principal_point),
        ),
    )


def focused_plenoptic_of(part: FocusedPlenopticPart, picture: PictureSettings | None) -> FocusedPlenoptic:
    """A focused plenoptic camera; its array is put where the declared plane is the total covering plane.

    With b_M the image distance of that plane, ``z = b_M ± 2 b_L`` (Keplerian +, Galilean −); with f-number matching,
    where ``b_L = p z / A``, this is ``z = b_M / (1 ∓ 2p/A)``.
    """
    sensor = sensor_of(part.sensor)
    lens = lens_of(part.main_lens, sensor)
    array = part.microlenses
    gap_over_z = array.pitch / lens.pupil_diameter
    sign = -1.0 if part.focus.relay == "galilean" else 1.0
    if part.focus.mla_distance is not None:
        z = part.focus.mla_distance
        gap = gap_over_z * z if array.gap == "f-number-matching" else array.gap
        sign = math.copysign(1.0, z - lens.focal_length)
    else:
        plane = part.focus.total_covering_plane
        if plane is None or not plane > lens.focal_length:
            raise OutOfRangeError(
                "the total covering plane",
                value="none" if plane is None else f"{plane * 1e3:g} mm",
                limit=f"beyond the main lens's focal length, {lens.focal_length * 1e3:g} mm",
            )
        b = float(image_distance(plane, lens.focal_length))
        if array.gap == "f-number-matching":
            z = b / (1.0 - sign * COVERING_VIRTUAL_DEPTH * gap_over_z)
            gap = gap_over_z * z
        else:
            gap = array.gap
            z = b + sign * COVERING_VIRTUAL_DEPTH * gap
    if not (z > 0.0 and gap > 0.0):
        raise OutOfRangeError(
            "the microlens array would stand before the main lens", value=f"{z * 1e3:g} mm", remedy="reduce the gap"
        )
    depth = part.depth
    pair = {"adjacent-pair": "all", "same-type-pair": "sharpest-type"}
    return FocusedPlenoptic(
        main_lens=lens,
        sensor=sensor,
        microlenses=MicrolensArray(
            layout=array.layout,
            pitch=array.pitch,
            gap=gap,
            focal_lengths=array.focal_lengths or _designed_focal_lengths(part, gap, sign),
            aperture_diameter=array.aperture_diameter or array.pitch,
        ),
        mla_distance=z,
        estimator=depth.estimator,
        lenses="all" if pair.get(depth.estimator, depth.lenses) == "all" else "sharpest-type",
        disparity_error_px=disparity_error_of(depth, picture, microlenses=True),
        discrimination_step_px=depth.discrimination_step,
        calibration=plenoptic_calibration_of(part.calibration),
    )


def plenoptic_calibration_of(part: PlenopticCalibrationPart) -> PlenopticCalibration:
    """Calibration errors of a plenoptic camera of either kind."""
    return PlenopticCalibration(
        mla_distance=error_of(part.mla_distance),
        focal_length=error_of(part.focal_length),
        correlation=part.correlation,
        microlens_gap=error_of(part.microlens_gap),
    )


def _designed_focal_lengths(part: FocusedPlenopticPart, gap: float, sign: float) -> tuple[float, ...]:
    """Focal lengths of types whose depths of field touch, at one pixel of blur, from the total covering plane on."""
    array = part.microlenses
    inverse_depths = touching_inverse_virtual_depths(
        nearest_virtual_depth=COVERING_VIRTUAL_DEPTH,
        pixels_per_lens=(array.aperture_diameter or array.pitch) / part.sensor.pixel_pitch,
        types=array.types,
    )
    return tuple(float(focal_length) for focal_length in microlens_focal_length(sign * inverse_depths, gap))


def unfocused_plenoptic_of(part: UnfocusedPlenopticPart, picture: PictureSettings | None) -> UnfocusedPlenoptic:
    """An unfocused plenoptic camera; with f-number matching ``f_L = p z/A``."""
    sensor = sensor_of(part.sensor)
    lens = lens_of(part.main_lens, sensor)
    array = part.microlenses
    if not part.focus.distance > lens.focal_length:
        raise OutOfRangeError(
            "the main lens cannot focus that close",
            value=f"{part.focus.distance * 1e3:g} mm",
            limit=f"beyond the focal length, {lens.focal_length * 1e3:g} mm",
            remedy="increase the focus distance",
        )
    z = float(image_distance(part.focus.distance, lens.focal_length))
    matching = array.focal_length == "f-number-matching"
    focal_length = array.pitch * z / lens.pupil_diameter if matching else float(array.focal_length)
    aperture = array.aperture_diameter or (focal_length / array.f_number if array.f_number else array.pitch)
    return UnfocusedPlenoptic(
        main_lens=lens,
        sensor=sensor,
        microlenses=MicrolensArray(
            layout=array.layout,
            pitch=array.pitch,
            gap=focal_length,
            focal_lengths=(focal_length,),
            aperture_diameter=aperture,
        ),
        focus_distance=part.focus.distance,
        estimator=part.depth.estimator,
        disparity_error_px=disparity_error_of(part.depth, picture),
        discrimination_step_px=part.depth.discrimination_step,
        calibration=plenoptic_calibration_of(part.calibration),
    )


def conventional_of(part: ConventionalPart) -> ConventionalCamera:
    """A conventional camera, focused by distance, by image scale, or by a data sheet's working distance.

    The scale s of a pixel p gives the magnification p/s and with it the distance of the principal plane; at a reference
    it tells how far that plane lies behind the front of the lens, which is supposed to stay so.
    """
    sensor = sensor_of(part.sensor)
    lens = lens_of(part.lens, sensor)
    focus = part.focus

    def by_scale(image_scale: float) -> float:
        return float(object_distance_of_magnification(lens.focal_length, sensor.pixel_pitch / image_scale))

    behind_front = None
    if focus.reference is not None:
        behind_front = by_scale(focus.reference.image_scale) - focus.reference.working_distance
    stack = focus.stack
    return ConventionalCamera(
        lens=lens,
        sensor=sensor,
        focus_distance=_focus_distance(focus, by_scale),
        stack=None
        if stack is None
        else FocusStackPlan(
            near=stack.start, far=stack.stop, most_images=stack.images, time_per_image=stack.time_per_image
        ),
        front_to_principal_plane=behind_front,
    )


def _focus_distance(focus: ConventionalFocusPart, by_scale: Callable[[float], float]) -> float:
    """Distance of the focus from the principal plane [m], whichever way it is given."""
    if focus.distance is not None:
        return focus.distance
    if focus.image_scale is not None:
        return by_scale(focus.image_scale)
    assert focus.working_distance is not None and focus.reference is not None  # noqa: PT018 - the schema's promise, for the type checker
    return float(
        object_distance_of_working_distance(
            focus.working_distance,
            reference_working_distance=focus.reference.working_distance,
            reference_object_distance=by_scale(focus.reference.image_scale),
        )
    )


def blur_criterion_of(part: BlurPart, wavelength: float) -> BlurCriterion:
    """What counts as sharp, in the light of the scene."""
    return BlurCriterion(blur_px=part.blur, measure=part.diffraction, wavelength=wavelength)


def sensor_of(part: SensorPart) -> Sensor:
    """A pixel array."""
    return Sensor(columns=part.pixels[0], rows=part.pixels[1], pixel_pitch=part.pixel_pitch)


def lens_of(part: LensPart, sensor: Sensor) -> Lens:
    """A lens, its focal length given or from the field of view on this sensor."""
    focal_length = part.focal_length
    if focal_length is None:
        assert part.field_of_view is not None  # the schema asks for one of the two
        extent = sensor.diagonal if part.across == "diagonal" else sensor.width
        focal_length = focal_length_of_field_of_view(part.field_of_view, extent)
    return Lens(focal_length=focal_length, f_number=part.f_number)


def error_of(part: LengthErrorPart | AngleErrorPart | NormalLengthErrorPart | None) -> ErrorSource:
    """A normal error by its standard deviation or a uniform one by its half width h, of deviation h/√3."""
    if part is None:
        return ErrorSource(standard_deviation=0.0)
    half_width = getattr(part, "half_width", None)
    if half_width is not None:
        return ErrorSource(standard_deviation=half_width / math.sqrt(3.0), shape="uniform")
    return ErrorSource(standard_deviation=part.standard_deviation or 0.0)
