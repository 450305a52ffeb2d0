"""The choice of a model for the depth of field: whether criteria of sharpness include the diffraction spot."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from tradestudy.accuracy import Quantity
from tradestudy.cameras.focus import BlurCriterion, Focus
from tradestudy.effects import OFF, Models, models_of
from tradestudy.models.point_spreads import LensAndPoint, SpreadMethod, every_case, spread_measures
from tradestudy.models.problem import Change, Changes, SimulationProblem, Slot
from tradestudy.optics.arrays import FloatArray
from tradestudy.study.schema.questions import PROBLEM
from tradestudy.study.schema.wave_optics import PointSpreadPart


class DepthOfFieldProblem(SimulationProblem):
    """Every camera of a study under its criteria of sharpness.

    Both models are closed forms that cost no time: the diffraction spot is included unless the study switches it off.
    """

    name, title = PROBLEM, "Depth of field"
    asked = ("depth_of_field",)

    def __init__(self, focuses: Sequence[Focus], criteria: Sequence[BlurCriterion], forced: Models) -> None:
        self._focuses = tuple(focuses)
        self._criteria = tuple(criterion for criterion in criteria if criterion.measure != "none")
        models, reason = models_of("main_lens_diffraction", "sharpness"), ""
        if not self._criteria:
            models, reason = (OFF,), "no criterion includes the diffraction spot"
        fixed = {slot: model for slot, model in forced.items() if model in models}
        self.slots = (Slot(name="main_lens_diffraction", models=models, saves_time=False, reason=reason).under(fixed),)

    def changes(self, models: Models) -> Changes:
        """The largest change of a near or far end; infinite where an end appears or vanishes."""
        if models == self.complete:
            return {"depth_of_field": Change(relative=0.0)}
        pairs = [
            [focus.sharp_range(variant).slices for variant in (criterion, replace(criterion, measure="none"))]
            for focus in self._focuses
            for criterion in self._criteria
        ]
        ends = [[np.atleast_1d(getattr(slices, end)) for slices in pair] for pair in pairs for end in ("near", "far")]
        return {"depth_of_field": Change(relative=max((_largest(new, old) for old, new in ends), default=0.0))}


def _largest(new: FloatArray, old: FloatArray) -> float:
    """Largest relative difference; infinite where only one of the two ends is finite."""
    if new.shape != old.shape:
        return math.inf
    same = (new == old) | (np.isnan(new) & np.isnan(old))
    with np.errstate(invalid="ignore"):  # ∞/∞ where both are infinite, which counts as equal
        change = np.where(same, 0.0, np.abs(new / old - 1.0))
    return float(np.max(np.where(np.isnan(change), math.inf, change), initial=0.0))


NAME: Final = "point-spread"
_TRIED: Final = 2  # steepest cases


class PointSpreadProblem(SimulationProblem):
    """The declared images of points; their width is the radius that encloses half of the light.

    A run computes each image by both laws, since each checks the other: leaving out Kirchhoff's law saves no time.
    """

    def __init__(self, part: PointSpreadPart, forced: Models) -> None:
        self.name = NAME
        self.title = "Point spreads"
        self.asked: tuple[Quantity, ...] = ("psf_width",)
        laws = models_of("main_lens_diffraction", "point")
        fixed = {slot: model for slot, model in forced.items() if model in laws}
        self.slots = (Slot(name="main_lens_diffraction", models=laws, saves_time=False).under(fixed),)
        self._part = part
        self._fresnel: float | None = None

    def changes(self, models: Models) -> Changes:
        """Relative change of the width by Fresnel's law in place of Kirchhoff's."""
        if models == self.complete:
            return {"psf_width": Change(relative=0.0)}
        return {"psf_width": Change(relative=math.inf if self._fresnel is None else self._fresnel, evidence="trial")}

    def try_out(self, models: Models) -> bool:
        """Compute by both laws the images with the steepest rays, where Fresnel's law errs most."""
        if self._fresnel is not None or models == self.complete:
            return False
        steepest = sorted(every_case(self._part), key=lambda case: case.f_number / (1.0 + case.field_angle))[:_TRIED]
        self._fresnel = max(map(self._change, steepest))
        return True

    def _change(self, case: LensAndPoint) -> float:
        fresnel, kirchhoff = (self._width(case, law) for law in ("fresnel", "kirchhoff"))
        return abs(fresnel / kirchhoff - 1.0) if kirchhoff > 0.0 else math.inf

    def _width(self, case: LensAndPoint, law: SpreadMethod) -> float:
        part = self._part
        measures = spread_measures(
            case,
            method=law,
            window=part.window,
            rms_radius=part.rms_radius,
            pixel_pitch=part.pixel_pitch,
            tolerance=part.tolerance,
        )
        return measures["half_energy_radius"][0]
