"""Cameras to be calibrated, built by hand, and what is asked of their calibration."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from tests.data.simulate_corners import FILE as SIMULATED
from tradestudy.calibration.camera_target import TargetToInfer
from tradestudy.calibration.posteriors import CornersToInfer
from tradestudy.cameras.calibration_declaration import CornersPart, TargetPart
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.focused_plenoptic.design import FocusedPlenoptic
from tradestudy.cameras.parts import Lens, MicrolensArray, Sensor
from tradestudy.cameras.stereo.design import StereoRig
from tradestudy.cameras.unfocused_plenoptic.design import UnfocusedPlenoptic
from tradestudy.uncertainty.distributions import Normal
from tradestudy.uncertainty.sources import ErrorClass, Group, Source

MEASURED = Path(__file__).parents[2] / "studies" / "data" / "stereo_chessboard_corners.csv"
PITCH = 126.5e-6


def stereo(**changes: Any) -> StereoRig:
    """The stereo rig of the headline study: 65.24° across 1024 pixels, 100 mm between parallel axes."""
    values: dict[str, Any] = {
        "lens": Lens(focal_length=5.12e-3 / math.tan(math.radians(32.62)), f_number=8.0),
        "sensor": Sensor(columns=1024, rows=1024, pixel_pitch=10e-6),
        "focus_distance": 1.0,
        "baseline": 0.1,
        "convergence_angle": 0.0,
        "triangulation": "disparity",
        "disparity_error_px": 0.1,
        "discrimination_step_px": 0.1,
    }
    return StereoRig(**(values | changes))


def webcams(**changes: Any) -> StereoRig:
    """The pair of the measured corners, as `studies/real_rig.yaml` declares it."""
    values: dict[str, Any] = {
        "lens": Lens(focal_length=1.388e-3, f_number=2.8),
        "sensor": Sensor(columns=640, rows=360, pixel_pitch=3e-6),
        "focus_distance": None,
        "baseline": 94.2e-3,
        "disparity_error_px": 0.17,
    }
    return stereo(**(values | changes))


def focused(**changes: Any) -> FocusedPlenoptic:
    """The R5 with its total covering plane at 150 mm."""
    gap = 0.568093e-3
    values: dict[str, Any] = {
        "main_lens": Lens(focal_length=12.5e-3, f_number=3.8),
        "sensor": Sensor(columns=2048, rows=2048, pixel_pitch=5.5e-6),
        "microlenses": MicrolensArray(
            layout="hexagonal",
            pitch=PITCH,
            gap=gap,
            focal_lengths=tuple(gap / (1.5 - k / 23) for k in (1, 3, 5)),
            aperture_diameter=PITCH,
        ),
        "mla_distance": 14.77255e-3,
        "estimator": "same-type-pair",
        "lenses": "sharpest-type",
        "disparity_error_px": 0.1,
        "discrimination_step_px": 0.1,
    }
    return FocusedPlenoptic(**(values | changes))


def unfocused(**changes: Any) -> UnfocusedPlenoptic:
    """The parts of the R5 with the sensor one microlens focal length behind the array, focused at 150 mm."""
    values: dict[str, Any] = {
        "main_lens": Lens(focal_length=12.5e-3, f_number=3.8),
        "sensor": Sensor(columns=2048, rows=2048, pixel_pitch=5.5e-6),
        "microlenses": MicrolensArray(
            layout="hexagonal", pitch=PITCH, gap=0.432e-3, focal_lengths=(0.432e-3,), aperture_diameter=113.7e-6
        ),
        "focus_distance": 0.15,
        "estimator": "outermost-views",
        "disparity_error_px": 0.1,
        "discrimination_step_px": 0.1,
    }
    return UnfocusedPlenoptic(**(values | changes))


def normal(name: str, deviation: float, error_class: ErrorClass = ErrorClass.RIG) -> Source:
    """A normal error."""
    return Source(name=name, distribution=Normal(mean=0.0, standard_deviation=deviation), error_class=error_class)


def board(**changes: Any) -> TargetPart:
    """A small board shown to a stereo rig in a few views."""
    values: dict[str, Any] = {
        "views": 8, "columns": 3, "rows": 3, "spacing": 0.1, "distances": (1.0, 3.0), "half_field_angle": 0.05,
        "tilt": 0.436, "corner_noise": 0.1, "max_steps": 600,
    }  # fmt: skip
    return TargetPart.model_construct(**(values | changes))


def shown(camera: DepthCamera, groups: tuple[Group, ...], part: TargetPart, *, seed: int = 0) -> TargetToInfer:
    """A target shown to a camera with these priors."""
    return TargetToInfer(name="rig", camera=camera, groups=groups, part=part, seed=seed)


def corners(camera: DepthCamera, file: Path = SIMULATED, *, seed: int = 0, steps: int = 20_000) -> CornersToInfer:
    """A corner file for a rig."""
    part = CornersPart.model_construct(file=file.name, max_steps=steps)
    return CornersToInfer.of("rig", camera, part, file.parent, seed=seed)
