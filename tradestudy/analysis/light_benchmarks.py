"""What one aperture and one source point through both lenses take, with the errors that they state."""

from __future__ import annotations

from collections.abc import MutableMapping
from itertools import product
from typing import Final

import numpy as np

from tradestudy.analysis.spot_images import light_path
from tradestudy.execution.steps import timed
from tradestudy.optics.chain import KIRCHHOFF, ChainAccuracy, chain_image
from tradestudy.optics.propagation import (
    LENS_PHASES,
    CircularLens,
    FieldAccuracy,
    LensPhase,
    PointSource,
    TargetGrid,
    aperture_field,
)
from tradestudy.study.schema.light_spot import LightSpotPart

_REPEATS: Final = 3  # the least time counts: what else runs on the machine only ever adds
_OFF_AXIS: Final = 2e-3
_TARGETS, _TARGET_PITCH = 256, 0.25e-6
_APERTURE_TOLERANCE: Final = 1e-6
_POINT_TOLERANCE: Final = 1e-4


def light_benchmarks(part: LightSpotPart, seconds: MutableMapping[str, float]) -> dict[str, float]:
    """Stated errors (relative L2) by the name of the case; the seconds go to ``seconds`` under the same names."""
    errors: dict[str, float] = {}
    places = (("on axis", 0.0), (f"{_OFF_AXIS * 1e3:g} mm off axis", _OFF_AXIS))
    for phase, (where, x) in product(LENS_PHASES, places):
        name = f"main lens alone, {_TARGETS}² targets, Kirchhoff, {phase}, {where}"
        found = [_aperture(part, phase, x) for _ in range(_REPEATS)]
        errors[name] = found[0][1]
        seconds[name] = min(took for took, _ in found)
    name = "one source point, both lenses, Kirchhoff on both legs"
    with timed(seconds, name):
        errors[name] = chain_image(
            light_path(part),
            PointSource(distance=part.spot.distance),
            wavelength=part.mean_wavelength,
            legs=KIRCHHOFF,
            accuracy=ChainAccuracy(tolerance=_POINT_TOLERANCE),
            rng=np.random.default_rng(part.seed),
        ).numerical_error
    return errors


def _aperture(part: LightSpotPart, phase: LensPhase, x: float) -> tuple[float, float]:
    """Seconds without the check, and the stated error, in the plane of the thin-lens image."""
    lens, distance = part.main_lens, part.spot.distance
    image = lens.focal_length * distance / (distance - lens.focal_length)
    field = aperture_field(
        source=PointSource(x=x, distance=distance),
        lens=CircularLens(
            radius=lens.focal_length / lens.f_number / 2,
            focal_length=lens.focal_length,
            lens_phase=phase,
            focus_distance=distance if phase == "stigmatic" else None,
        ),
        targets=TargetGrid.centred(
            centre=(-x * image / distance, 0.0), pitch=_TARGET_PITCH, count=_TARGETS, distance=image
        ),
        wavelength=part.mean_wavelength,
        method="kirchhoff",
        accuracy=FieldAccuracy(tolerance=_APERTURE_TOLERANCE),
    )
    return field.effort.seconds, field.error.intensity
