"""Cameras of the paper, built by hand from its numbers."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.calibration import Calibration
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.focused_plenoptic.design import FocusedPlenoptic
from tradestudy.cameras.parts import Lens, MicrolensArray, Sensor
from tradestudy.cameras.stereo.design import StereoRig
from tradestudy.cameras.unfocused_plenoptic.design import UnfocusedPlenoptic
from tradestudy.optics.triangulation import depth_of_inverse
from tradestudy.uncertainty.distributions import Normal
from tradestudy.uncertainty.sources import ErrorClass, Source

PITCH = 126.5e-6
F_MAIN = 12.5e-3
F_L = 0.432e-3
YAW = Source(
    name="yaw",
    distribution=Normal(mean=0.0, standard_deviation=math.radians(0.2)),
    error_class=ErrorClass.RIG,
)


def unfocused(**changes: Any) -> UnfocusedPlenoptic:
    """The R5's lens and sensor behind microlenses of the one published focal length, focused at 150 mm."""
    values: dict[str, Any] = {
        "main_lens": Lens(focal_length=F_MAIN, f_number=3.8),
        "sensor": Sensor(columns=2048, rows=2048, pixel_pitch=5.5e-6),
        "microlenses": MicrolensArray(
            layout="hexagonal", pitch=PITCH, gap=F_L, focal_lengths=(F_L,), aperture_diameter=F_L / 3.8
        ),
        "focus_distance": 0.15,
        "estimator": "outermost-views",
        "disparity_error_px": 0.1,
        "discrimination_step_px": 0.1,
    }
    return UnfocusedPlenoptic(**(values | changes))


def depth_read(camera: DepthCamera, distance: ArrayLike, field: float = 0.0, **errors: ArrayLike) -> np.ndarray:
    """Depths [m], shape (distances,) or (draws, distances), that a camera reads with a calibration off by errors."""
    drawn = {name: np.reshape(value, (-1, 1)) for name, value in errors.items()}
    found = depth_of_inverse(camera.read(np.atleast_1d(distance).astype(float), field, drawn).inverse_depth)
    return found[0] if found.ndim == 2 and len(found) == 1 else found


def r5(**changes: Any) -> FocusedPlenoptic:
    """Keplerian R5: z and gap to the digits that are published for the total covering plane at 150 mm."""
    gap = 0.568093e-3
    # Types in focus at 1/v = 1/2 − (1, 3, 5)/23.
    focal_lengths = tuple(gap / (1 + 0.5 - k / 23) for k in (1, 3, 5))
    values: dict[str, Any] = {
        "main_lens": Lens(focal_length=F_MAIN, f_number=3.8),
        "sensor": Sensor(columns=2048, rows=2048, pixel_pitch=5.5e-6),
        "microlenses": MicrolensArray(
            layout="hexagonal", pitch=PITCH, gap=gap, focal_lengths=focal_lengths, aperture_diameter=PITCH
        ),
        "mla_distance": 14.77255e-3,
        "estimator": "same-type-pair",
        "lenses": "sharpest-type",
        "disparity_error_px": 0.1,
        "discrimination_step_px": 0.1,
    }
    return FocusedPlenoptic(**(values | changes))


def stereo(**changes: Any) -> StereoRig:
    """Table 1a as printed, with normal yaw of 0.2°."""
    values: dict[str, Any] = {
        "lens": Lens(focal_length=30.5e-3, f_number=4.0),
        "sensor": Sensor(columns=1024, rows=1024, pixel_pitch=10e-6),
        "focus_distance": 1.0,
        "baseline": 0.1,
        "convergence_angle": 0.0,
        "triangulation": "disparity",
        "disparity_error_px": 0.1,
        "discrimination_step_px": 0.1,
        "calibration": Calibration(groups=(YAW,)),
    }
    return StereoRig(**(values | changes))
