"""/depth_loop: every plane that the cameras measured, and the matchers fitted to some of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from tradestudy.errors import OutOfRangeError
from tradestudy.execution import Steps
from tradestudy.imaging.estimation import MatcherFit, fit_errors, require_windows, true_matches
from tradestudy.results import dataset
from tradestudy.run.depth_loop import LoopFinding, loop_points, measure_loop
from tradestudy.run.groups.depth_maps import score_values
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.scene import DepthLoopPart


def depth_loop_group(definition: StudyDefinition, part: DepthLoopPart, steps: Steps) -> xr.Dataset:
    """/depth_loop over cameras, distances, contrasts and electrons."""
    points = loop_points(definition, part)
    found = measure_loop(points, steps)
    cameras = list(dict.fromkeys(key[0] for key in points))
    labels = {
        name: list(dict.fromkeys(key[k] for key in points))
        for k, name in enumerate(("camera", "distance", "contrast", "electrons"))
    }
    shape = tuple(map(len, labels.values()))
    findings = list(found.values())
    fits = {
        name: _fit([one for key, one in found.items() if key[0] == name and key[1] in part.fitted_at])
        for name in cameras
    }
    over = [_over_matcher(one, fits[key[0]]) for key, one in found.items()]

    def arranged(values: Sequence[Any]) -> Any:
        return np.array(values).reshape(shape)

    return dataset(
        "depth_loop",
        {
            **{name: arranged(values) for name, values in score_values([one.score for one in findings]).items()},
            "predicted_availability": arranged([one.available for one in findings]),
            "reason": arranged([one.reason for one in findings]),
            "blur_px": arranged([one.blur_px for one in findings]),
            "over_matcher": arranged([value for value, _ in over]),
            "over_matcher_error": arranged([error for _, error in over]),
            "fitted": [float(one in part.fitted_at) for one in labels["distance"]],
            **_matchers([fits[name] for name in cameras]),
        },
        labels,
    )


def _fit(findings: Sequence[LoopFinding]) -> MatcherFit | str:
    """The matcher of one camera, or why there is none.

    Errors are taken from their median at each distance, as in tests of the matcher, because a bias is not noise.
    """
    measured = [one for one in findings if one.errors_px.size]
    try:
        require_windows(sum(one.errors_px.size for one in measured))
    except OutOfRangeError as refused:
        return str(refused)
    errors = np.concatenate([one.errors_px - np.median(one.errors_px) for one in measured])
    bounds = np.concatenate([one.bounds_px for one in measured])
    return fit_errors(errors, bounds, float(errors.size))


def _over_matcher(one: LoopFinding, fit: MatcherFit | str) -> tuple[float, float]:
    """Standard deviation of the errors of true matches relative to the matcher's prediction, and its standard error."""
    if isinstance(fit, str) or not one.errors_px.size:
        return math.nan, math.nan
    relative = one.errors_px / fit.matcher.error_px(one.bounds_px)
    relative = relative[true_matches(relative)]
    spread, kurtosis = float(np.std(relative)), float(np.mean(((relative - relative.mean()) / relative.std()) ** 4))
    return spread, spread * math.sqrt((kurtosis - 1.0) / (4.0 * relative.size))


def _matchers(fits: Sequence[MatcherFit | str]) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {"matcher": [one if isinstance(one, str) else one.declaration for one in fits]}
    for name in ("factor", "floor", "false_matches"):
        found[f"matcher_{name}"] = [
            math.nan if isinstance(one, str) else float(getattr(one.matcher, name)) for one in fits
        ]
        found[f"matcher_{name}_error"] = [
            math.nan if isinstance(one, str) else float(getattr(one, f"{name}_error")) for one in fits
        ]
    return found


def matcher_file(data: xr.Dataset, study: str) -> str:
    """The fitted matchers as YAML for the ``cameras`` of a study, with their errors as comments.

    Parameters
    ----------
    data
        The group ``/depth_loop``.
    study
        Name of the study.
    """
    lines = [f"# Fitted by the depth loop of {study}, for cameras with disparity_error: derived.", "cameras:"]
    for name, matcher, factor in zip(
        data["camera"].values, data["matcher"].values, data["matcher_factor"].values, strict=True
    ):
        if math.isnan(factor):
            lines.append(f"  # {name}: {matcher}")
        else:
            declared, _, errors = str(matcher).partition("  # ")
            lines += [f"  {name}:", f"    depth:  # {errors}", f"      {declared}"]
    return "\n".join(lines) + "\n"
