"""/disparity_causes: the causes of derived disparity errors; and the pictures that they need, computed beforehand."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import xarray as xr

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.picture_geometry import PictureGeometry
from tradestudy.execution.steps import Progress
from tradestudy.imaging.models import AT_BOUND
from tradestudy.imaging.optical_transfer import kirchhoff_correction
from tradestudy.imaging.passed_texture import matched_window, picture_electrons
from tradestudy.imaging.picture import (
    CHANGES,
    ErrorCauses,
    PictureDisparityError,
    error_causes,
    filled_share,
    kirchhoff_lattice,
)
from tradestudy.models.depth_problem import applicable
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset, distances_without_decision
from tradestudy.study.prepared import PreparedStudy, complete_in_closed_form, in_closed_form, with_models

STEP: Final = "pictures"


def disparity_causes_group(study: PreparedStudy) -> xr.Dataset | None:
    """/disparity_causes of the study as declared, without its sweep; None if no disparity error is derived.

    Uses the most complete closed-form models, even where depth omits effects, because an omitted cause would
    seem to have no effect; models that the study names take precedence.
    """
    forced = study.file.effects.forced()
    derived = {
        name: (camera, replace(law, models=with_models(complete_in_closed_form(camera, law), in_closed_form(applied))))
        for name, camera in study.case.cameras.items()
        if isinstance(law := camera.disparity_error_px, PictureDisparityError)
        and (applied := applicable(camera, forced)) is not None
    }
    if not derived:
        return None
    decision = study.file.decision
    distance = (
        distances_without_decision(study.case.distance) if decision is None else np.array(sorted(set(decision.at)))
    )
    names = list(derived)
    light = [_electrons(camera, law, distance) for camera, law in derived.values()]
    electrons = np.stack([n for n, _ in light])
    brightest = _brightest(electrons, np.stack([share for _, share in light]))
    deficits = [_light_deficit(electrons, k, brightest) for k in range(len(names))]
    causes = [
        error_causes(camera.picture_geometry(distance), law.settings, law.models, ratio)
        for (camera, law), ratio in zip(derived.values(), deficits, strict=True)
    ]
    return dataset(
        "disparity_causes",
        {
            "matched_window_px": np.stack(
                [_window(camera.picture_geometry(distance), law) for camera, law in derived.values()]
            ),
            "electrons": electrons,
            "disparity_error_px": np.stack([cause.value for cause in causes]),
            "disparity_error_px_error": np.stack([cause.error for cause in causes]),
            "disparity_error_px_changed": np.stack([cause.changed.T for cause in causes]),
            "disparity_error_px_changed_error": np.stack([cause.changed_error.T for cause in causes]),
            "brightest_camera": ["" if k < 0 else names[k] for k in brightest],
            **_by_matchers([law for _, law in derived.values()], causes),
        },
        {"camera": names, "distance": distance, "change": list(CHANGES)},
    )


def _by_matchers(laws: Sequence[PictureDisparityError], causes: Sequence[ErrorCauses]) -> dict[str, Any]:
    """Errors of the declared matchers and their bounds; empty if none is declared."""
    if all(law.matcher == AT_BOUND for law in laws):
        return {}
    errors = [law.matcher.numerical_error_px(cause.value, cause.error) for law, cause in zip(laws, causes, strict=True)]
    return {
        "matched_error_px": np.stack(
            [law.matcher.error_px(cause.value) for law, cause in zip(laws, causes, strict=True)]
        ),
        "matched_error_px_error": np.stack(errors),
        "matcher": ["" if law.matcher == AT_BOUND else law.matcher.words for law in laws],
        "false_matches": [law.matcher.false_matches for law in laws],
    }


def _window(geometry: PictureGeometry, law: PictureDisparityError) -> FloatArray:
    """Side of the window [samples]; NaN where there is no picture."""
    side = matched_window(geometry, law.settings, law.models).side_px
    return np.where(np.isfinite(geometry.magnification), side, math.nan)


def _electrons(camera: DepthCamera, law: PictureDisparityError, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean electrons per pixel, and how full the brightest one is (1: full well); NaN where there is no picture."""
    geometry = camera.picture_geometry(distance)
    imaged = np.isfinite(geometry.magnification)
    light = (picture_electrons(geometry, law.settings, law.models), filled_share(geometry, law.settings, law.models))
    return np.where(imaged, light[0], math.nan), np.where(imaged, light[1], math.nan)


def _brightest(electrons: FloatArray, filled: FloatArray) -> list[int]:
    """Index of the unsaturated camera with the most light at each distance; −1 where only one forms a picture."""
    # Saturated cameras get fewer electrons than any other can have.
    fit = np.where(filled <= 1.0, electrons, -1.0)
    several = np.count_nonzero(np.isfinite(electrons), axis=0) > 1
    exists = several & (fit.max(axis=0) > 0.0)
    return [int(k) for k in np.where(exists, fit.argmax(axis=0), -1)]


def _light_deficit(electrons: FloatArray, camera: int, brightest: list[int]) -> FloatArray:
    """Electrons of the brightest camera relative to this one; NaN where this one is the brightest."""
    return np.array(
        [
            math.nan if k in (-1, camera) else electrons[k, place] / electrons[camera, place]
            for place, k in enumerate(brightest)
        ]
    )


def compute_kirchhoff_pictures(study: PreparedStudy, progress: Progress) -> None:
    """Compute Kirchhoff's correction to Fresnel for every camera over the study's distances, reporting progress.

    The corrections are cached where transfer functions look them up. Does nothing if no camera's models need them.
    """
    points = kirchhoff_lattice(study.case.cameras.values(), study.case.distance)
    for number, point in enumerate(points):
        progress(STEP, number / len(points))
        kirchhoff_correction(*point)
    if points:
        progress(STEP, 1.0)
