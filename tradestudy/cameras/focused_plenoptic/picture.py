"""The picture behind microlenses: the main lens's image, relayed onto the sensor."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.focused_plenoptic.estimator import PlenopticEstimator, UsedLenses
from tradestudy.cameras.focused_plenoptic.micro_images import MicroImages
from tradestudy.cameras.parts import Lens, MicrolensArray, Sensor
from tradestudy.cameras.picture_geometry import LensStage, PictureGeometry
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.thin_lens import image_distance, microlens_object_distance


def relayed_picture(
    distance: FloatArray,
    lens: Lens,
    array: MicrolensArray,
    sensor: Sensor,
    mla_distance: float,
    *,
    estimator: PlenopticEstimator,
    lenses: UsedLenses,
    radius_over_pitch: FloatArray,
    blur: FloatArray,
    used_type: NDArray[np.intp],
) -> PictureGeometry:
    """Micro-images of objects at distances [m], NaN where there is no picture.

    Parameters
    ----------
    distance, lens, array, sensor, mla_distance
        The objects and the camera.
    estimator, lenses, radius_over_pitch
        The micro-images compared, as for `MicroImages`.
    blur
        Blur of the micro-images [m], with the shape of ``distance``.
    used_type
        Index of their microlens type.
    """
    a, pixel = distance, sensor.pixel_pitch
    f, pupil = lens.focal_length, lens.pupil_diameter
    image = image_distance(a, f)
    relayed = np.asarray(microlens_object_distance(a, mla_distance, f))
    # An image on the array is magnified infinitely: there is no picture.
    relayed = np.where(relayed == 0.0, np.nan, relayed)
    relay = array.gap / np.abs(relayed)
    microlens = LensStage(
        aperture_diameter=array.aperture_diameter,
        focal_length=np.asarray(array.focal_lengths)[used_type],
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
    micro_image = min(array.pitch, pupil * array.gap / mla_distance)
    return PictureGeometry(
        distance=a,
        magnification=image / a * relay,
        sample_pitch=pixel,
        sample_width=pixel,
        sample_shape="square",
        pixel_pitch=pixel,
        compared=MicroImages(
            estimator=estimator,
            lenses=lenses,
            array=array,
            diameter_px=micro_image / pixel,
            neighbours_apart_px=array.pitch * relay * image / mla_distance / pixel,
            radius_over_pitch=radius_over_pitch,
        ),
        light_f_number=microlens.f_number,
        pupil_diameter=pupil,
        main_lens=main_lens,
        microlens=microlens,
        micro_image_diameter=micro_image,
    )
