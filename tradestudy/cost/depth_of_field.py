"""Depth of field: what counting diffraction costs, and how far geometric optics alone is from it."""

from __future__ import annotations

import math
from functools import partial
from typing import Final, get_args

import numpy as np

from tradestudy.cameras.focus import BlurCriterion, SharpRange
from tradestudy.cost.entries import CostTable
from tradestudy.cost.measuring import Allowance, entry_of, measure
from tradestudy.effects.base import OFF
from tradestudy.effects.selection import Selection
from tradestudy.execution.steps import Progress
from tradestudy.optics.depth_of_field import DiffractionMeasure
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.depth_of_field import DepthOfFieldPart

TITLES: Final[dict[DiffractionMeasure, str]] = {
    "none": "geometric",
    "fwhm": "diffraction at half maximum",
    "airy-diameter": "diffraction to the first dark ring",
}
_REFERENCE: Final[DiffractionMeasure] = "airy-diameter"
assert set(TITLES) == set(get_args(DiffractionMeasure))


def depth_of_field_cost(
    definition: StudyDefinition,
    part: DepthOfFieldPart,
    selection: Selection,
    allowance: Allowance,
    progress: Progress,
) -> CostTable:
    """Cost of the depth of field of every camera of the study under the widest blur that the study calls sharp.

    Where the selection leaves diffraction out, a run computes all criteria without it.
    """
    without = selection.name_of("main_lens_diffraction") == OFF
    step = "cost: depth_of_field"
    progress(step, 0.0)
    widest = max(one.blur for one in part.criteria.values())  # diffraction alone exceeds narrower ones sooner
    criteria = {
        measure_: BlurCriterion(blur_px=widest, measure=measure_, wavelength=definition.case.wavelength)
        for measure_ in TITLES
    }
    cameras = definition.case.all_cameras
    near, far = float(definition.case.distance[0]), float(definition.case.distance[-1])

    def ranges(measure_: DiffractionMeasure, _run: int) -> list[SharpRange]:
        return [camera.focus.sharp_range(criteria[measure_]) for camera in cameras.values()]

    reference = ranges(_REFERENCE, 0)
    entries = []
    for number, (measure_, title) in enumerate(TITLES.items()):
        progress(step, number / len(TITLES))
        timed = measure(partial(ranges, measure_), allowance)
        errors = [_difference(own, full, near, far) for own, full in zip(timed.values[0], reference, strict=True)]
        entries.append(
            entry_of(
                timed,
                model=title,
                setting="",
                evaluations=math.nan,
                error=max(errors),
                typical_error=float(np.median(errors)),
                chosen=any(
                    one.blur == widest and measure_ == ("none" if without else one.diffraction)
                    for one in part.criteria.values()
                ),
            )
        )
    progress(step, 1.0)
    return CostTable(
        name="depth_of_field",
        title="Depth of field",
        says=f"What {len(cameras)} cameras keep sharp within {widest:g} lateral samples, between the ends of the "
        "study's distances: seconds for all together; error is the share of the distances sharp by one of two "
        "criteria that is not sharp by both, for the worst camera.",
        reference="the criterion that counts diffraction to the first dark ring, the most complete one there is",
        reference_error=0.0,
        reference_seconds=next(entry.seconds for entry in entries if entry.error == 0.0),
        entries=tuple(entries),
        ways={title: f"diffraction: {measure_} under depth_of_field.criteria" for measure_, title in TITLES.items()},
    )


def _difference(one: SharpRange, other: SharpRange, near: float, far: float) -> float:
    """Length that is sharp by one alone over the length that is sharp by either; 0 where nothing is by both."""
    covered = [np.clip(found.union.covered, near, far) for found in (one, other)]
    ends = np.unique(np.concatenate([[near, far], *(intervals.ravel() for intervals in covered)]))
    middle, length = (ends[1:] + ends[:-1]) / 2.0, np.diff(ends)
    first, second = (
        np.any((low < middle) & (middle < high), axis=0)
        for low, high in (np.hsplit(intervals, 2) for intervals in covered)
    )
    either = float(np.sum(length[first | second]))
    return float(np.sum(length[first != second])) / either if either > 0.0 else 0.0
