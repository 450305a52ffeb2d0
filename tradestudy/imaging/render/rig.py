"""One camera as it was built: its errors, drawn once from the distribution that its calibration declares."""

from __future__ import annotations

import numpy as np

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.error_class import ErrorClass
from tradestudy.uncertainty.streams import point_generator


def drawn_errors(camera: DepthCamera, name: str, seed: int) -> dict[str, FloatArray]:
    """Draw a rig: one number for each parameter, and for those that every element has of its own one pair each.

    Parameters
    ----------
    camera
        With its calibration.
    name
        Of the camera, which random numbers go by.
    seed
        Of the study.

    Raises
    ------
    OutOfRangeError
        For a calibration with a model of its own, whose parameters are not those of the camera.
    """
    calibration = camera.calibration
    if calibration.vocabulary is not None or not calibration.inferred:
        raise OutOfRangeError(
            f"the calibration of {name} has parameters of its own, which no rig can be drawn from; scene.image.rig",
            value="drawn",
            limit="as-designed for such a camera",
            remedy="declare errors under calibration, or render the camera as designed",
        )
    values: dict[str, FloatArray] = {}
    for group in calibration.groups:
        rng = point_generator(seed=seed, point=f"rig {name}/{group.name}", replicate=0)
        elements = camera.elements if group.error_class is ErrorClass.ELEMENT else 0
        drawn = group.draw(rng.standard_normal((group.dimensions, 2 * elements or 1)))
        for parameter, row in zip(group.parameters, drawn, strict=True):
            values[parameter] = row.reshape(elements, 2) if elements else np.asarray(row[0])
    return calibration.errors(values)
