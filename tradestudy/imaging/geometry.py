"""Where and how large a camera pictures an object: what blur, noise and window of a picture depend on."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.focused_plenoptic import FocusedPlenoptic
from tradestudy.cameras.stereo import StereoRig
from tradestudy.cameras.unfocused_plenoptic import UnfocusedPlenoptic
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.thin_lens import blur_diameter, image_distance


@dataclass(frozen=True, kw_only=True, eq=False)
class LensStage:
    """One lens of a camera as it forms a picture; arrays over distance unless said otherwise.

    Parameters
    ----------
    aperture_diameter
        Of the lens, or of the part of it that one view uses [m], one number.
    focal_length
        [m].
    object_distance
        What it pictures to the lens [m]; negative for an image of the lens before it that lies behind it.
    plane_distance
        Lens to the plane in which its picture is looked at [m].
    blur_diameter
        Of the geometric blur in that plane [m].
    relay
        Magnification from that plane to the sensor: 1, or that of the microlenses.
    """

    aperture_diameter: float
    focal_length: FloatArray
    object_distance: FloatArray
    plane_distance: FloatArray
    blur_diameter: FloatArray
    relay: FloatArray

    @cached_property
    def f_number(self) -> FloatArray:
        """Working f-number: distance of the plane over the aperture."""
        return np.asarray(self.plane_distance / self.aperture_diameter)

    @cached_property
    def columns(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Magnification to the sensor, f-number and blur [m], as columns to stand beside a row over frequency."""
        return column(self.relay), column(self.f_number), column(self.blur_diameter)

    def finest_period(self, wavelength: float) -> float:
        """Of what passes the lens at some distance, on the sensor [m]; infinite where it forms no picture."""
        period = wavelength * self.f_number * self.relay
        return float(np.min(period, initial=np.inf, where=period > 0.0))

    def defocus(self, wavelength: float) -> FloatArray:
        """Signed path error at the rim, ``A²/8 (1/a + 1/b − 1/f)/λ`` [waves]."""
        vergence = 1.0 / self.object_distance + 1.0 / self.plane_distance - 1.0 / self.focal_length
        return np.asarray(self.aperture_diameter**2 / 8.0 * vergence / wavelength)

    def at(self, index: NDArray[np.intp]) -> LensStage:
        """The same at some of the distances."""
        return LensStage(
            aperture_diameter=self.aperture_diameter,
            focal_length=self.focal_length[index],
            object_distance=self.object_distance[index],
            plane_distance=self.plane_distance[index],
            blur_diameter=self.blur_diameter[index],
            relay=self.relay[index],
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class PictureGeometry:
    """How a camera pictures objects at given distances; arrays over distance unless said otherwise.

    Parameters
    ----------
    distance
        [m]; NaN in all arrays where the camera forms no picture.
    magnification
        Object to samples: size on the sensor over size on the object.
    sample_pitch
        Distance of neighbouring samples of the picture that is matched [m]: the pixel, or the microlens for the views
        of an unfocused plenoptic camera. One number, as all below but the stages.
    sample_width
        Side of the square, or diameter of the disc, that a sample collects light from [m].
    sample_shape
        ``square`` for pixels, ``disc`` for microlenses.
    pixel_pitch
        Of the sensor [m]: what collects electrons.
    widest_window_px
        Side of the largest square window in samples: that of the sensor, or the square that fits into a micro-image.
    light_f_number
        f-number of the cone that reaches a pixel, over distance.
    pupil_diameter
        Of the main lens [m].
    main_lens, microlens
        The stages of the picture. No microlens in stereo; none for the views of an unfocused camera either, whose
        microlenses mix neighbouring views and do not blur them.
    """

    distance: FloatArray
    magnification: FloatArray
    sample_pitch: float
    sample_width: float
    sample_shape: Literal["square", "disc"]
    pixel_pitch: float
    widest_window_px: float
    light_f_number: FloatArray
    pupil_diameter: float
    main_lens: LensStage
    microlens: LensStage | None

    @property
    def blur_px(self) -> FloatArray:
        """Sum of the geometric blurs of the stages [samples]."""
        stages = [stage for stage in (self.main_lens, self.microlens) if stage is not None]
        return np.asarray(sum(stage.blur_diameter * stage.relay for stage in stages) / self.sample_pitch)

    def in_focus(self) -> PictureGeometry:
        """The same without geometric blur."""
        main_lens, microlens = (
            None if stage is None else replace(stage, blur_diameter=np.zeros_like(stage.blur_diameter))
            for stage in (self.main_lens, self.microlens)
        )
        assert main_lens is not None  # every camera has one
        return replace(self, main_lens=main_lens, microlens=microlens)

    def at(self, index: NDArray[np.intp]) -> PictureGeometry:
        """The same at some of the distances."""
        return replace(
            self,
            distance=self.distance[index],
            magnification=self.magnification[index],
            light_f_number=self.light_f_number[index],
            main_lens=self.main_lens.at(index),
            microlens=None if self.microlens is None else self.microlens.at(index),
        )


def picture_geometry(camera: DepthCamera, distance: ArrayLike) -> PictureGeometry:
    """How a camera pictures objects at distances [m].

    A focused plenoptic camera matches the micro-images on its sensor, an unfocused one its views, a stereo rig its
    pictures; of several types of microlens, the least sharp that the estimator needs stands for all.

    Raises
    ------
    OutOfRangeError
        For a camera of another kind.
    """
    a = np.asarray(distance, dtype=np.float64)
    match camera:
        case StereoRig():
            return _stereo(camera, np.where(camera.images(a), a, np.nan))
        case FocusedPlenoptic():
            return _focused(camera, np.where(camera.images(a), a, np.nan))
        case UnfocusedPlenoptic():
            return _unfocused(camera, np.where(camera.images(a), a, np.nan))
        case _:
            raise OutOfRangeError(
                "a picture of this camera is not known",
                value=type(camera).__name__,
                limit="a stereo rig, a focused or an unfocused plenoptic camera",
            )


def _stereo(rig: StereoRig, a: FloatArray) -> PictureGeometry:
    f, pupil = rig.lens.focal_length, rig.lens.pupil_diameter
    focus = a if rig.focus_distance is None else np.full_like(a, rig.focus_distance)
    sensor = image_distance(focus, f)
    stage = LensStage(
        aperture_diameter=pupil,
        focal_length=np.full_like(a, f),
        object_distance=a,
        plane_distance=sensor,
        blur_diameter=blur_diameter(a, focus, f, pupil),
        relay=np.ones_like(a),
    )
    return PictureGeometry(
        distance=a,
        magnification=sensor / a,
        sample_pitch=rig.sensor.pixel_pitch,
        sample_width=rig.sensor.pixel_pitch,
        sample_shape="square",
        pixel_pitch=rig.sensor.pixel_pitch,
        widest_window_px=float(min(rig.sensor.columns, rig.sensor.rows)),
        light_f_number=stage.f_number,
        pupil_diameter=pupil,
        main_lens=stage,
        microlens=None,
    )


def _focused(camera: FocusedPlenoptic, a: FloatArray) -> PictureGeometry:
    array, pixel = camera.microlenses, camera.sensor.pixel_pitch
    f, pupil = camera.main_lens.focal_length, camera.main_lens.pupil_diameter
    used = camera.least_sharp_type(a)
    image = image_distance(a, f)
    relayed = np.asarray(camera.microlens_object_distance(a))
    # The main lens's image on the array is pictured infinitely large: no picture.
    relayed = np.where(relayed == 0.0, np.nan, relayed)
    relay = array.gap / np.abs(relayed)
    blur = np.take_along_axis(camera.blur_px(a), used[np.newaxis], axis=0)[0] * pixel
    microlens = LensStage(
        aperture_diameter=array.aperture_diameter,
        focal_length=np.asarray(array.focal_lengths)[used],
        object_distance=relayed,
        plane_distance=np.full_like(a, array.gap),
        blur_diameter=np.where(np.isnan(relayed), np.nan, blur),
        relay=np.ones_like(a),
    )
    main_lens = LensStage(
        aperture_diameter=pupil,
        focal_length=np.full_like(a, f),
        object_distance=a,
        plane_distance=image,
        blur_diameter=np.zeros_like(a),
        relay=relay,
    )
    micro_image = min(array.pitch, pupil * array.gap / camera.mla_distance)
    return PictureGeometry(
        distance=a,
        magnification=image / a * relay,
        sample_pitch=pixel,
        sample_width=pixel,
        sample_shape="square",
        pixel_pitch=pixel,
        widest_window_px=micro_image / pixel / math.sqrt(2.0),
        light_f_number=microlens.f_number,
        pupil_diameter=pupil,
        main_lens=main_lens,
        microlens=microlens,
    )


def _unfocused(camera: UnfocusedPlenoptic, a: FloatArray) -> PictureGeometry:
    array, f, z = camera.microlenses, camera.main_lens.focal_length, camera.mla_distance
    view = camera.view_pupil_diameter
    stage = LensStage(
        aperture_diameter=view,
        focal_length=np.full_like(a, f),
        object_distance=a,
        plane_distance=np.full_like(a, z),
        blur_diameter=blur_diameter(a, camera.focus_distance, f, view),
        relay=np.ones_like(a),
    )
    return PictureGeometry(
        distance=a,
        magnification=z / a,
        sample_pitch=array.pitch,
        sample_width=array.aperture_diameter,
        sample_shape="disc",
        pixel_pitch=camera.sensor.pixel_pitch,
        widest_window_px=min(camera.sensor.width, camera.sensor.height) / array.pitch,
        light_f_number=np.full_like(a, array.gap / array.aperture_diameter),
        pupil_diameter=camera.main_lens.pupil_diameter,
        main_lens=stage,
        microlens=None,
    )


def column(values: FloatArray) -> FloatArray:
    """Values over distance as a column, to stand beside a row over frequency; one number where all are the same."""
    found = values[:, np.newaxis]
    return found[:1] if values.size and np.all(values == values[0]) else found
