"""The errors of one camera as built, drawn once from the distribution that its calibration declares."""

from __future__ import annotations

import numpy as np

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.sources import ErrorClass
from tradestudy.uncertainty.streams import point_generator


def drawn_errors(camera: DepthCamera, name: str, seed: int) -> dict[str, FloatArray]:
    """Draw the errors of a camera: a number for each parameter, or a pair for each element.

    Parameters
    ----------
    camera
        The camera with its calibration.
    name
        Name of the camera, which selects its random numbers.
    seed
        Seed of the study.

    Raises
    ------
    OutOfRangeError
        The calibration has its own model, whose parameters are not those of the camera.
    """
    calibration = camera.calibration
    if calibration.vocabulary is not None or not calibration.inferred:
        raise OutOfRangeError(
            f"scene.image.rig for {name}, whose calibration has its own parameters",
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
