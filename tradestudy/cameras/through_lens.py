"""The picture that one lens forms on one sensor, as a matcher sees it."""

from __future__ import annotations

import numpy as np

from tradestudy.cameras.matched_windows import WholePictures
from tradestudy.cameras.parts import Lens, Sensor
from tradestudy.cameras.picture_geometry import LensStage, PictureGeometry
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.thin_lens import blur_diameter, image_distance


def picture_through_lens(distance: FloatArray, lens: Lens, sensor: Sensor, focus: FloatArray) -> PictureGeometry:
    """The picture of objects at distances [m] through a lens focused at ``focus`` [m] for each; NaN without one.

    The largest window is the whole sensor.
    """
    f, pupil = lens.focal_length, lens.pupil_diameter
    to_sensor = image_distance(focus, f)
    stage = LensStage(
        aperture_diameter=pupil,
        focal_length=np.full_like(distance, f),
        object_distance=distance,
        plane_distance=to_sensor,
        blur_diameter=blur_diameter(distance, focus, f, pupil),
        relay=np.ones_like(distance),
    )
    return PictureGeometry(
        distance=distance,
        magnification=to_sensor / distance,
        sample_pitch=sensor.pixel_pitch,
        sample_width=sensor.pixel_pitch,
        sample_shape="square",
        pixel_pitch=sensor.pixel_pitch,
        compared=WholePictures(side_px=np.full_like(distance, min(sensor.columns, sensor.rows))),
        light_f_number=stage.f_number,
        pupil_diameter=pupil,
        main_lens=stage,
        microlens=None,
    )
