"""The choice of a propagation law for the images of points behind single lenses."""

from __future__ import annotations

import math
from typing import Final

from tradestudy.accuracy import Quantity
from tradestudy.analysis.point_spreads import LensAndPoint, SpreadMethod, every_case, spread_measures
from tradestudy.effects import Change, Changes, Models, SimulationProblem, Slot, models_of
from tradestudy.study.schema.wave_optics import PointSpreadPart

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
        own = {slot: name for slot, name in forced.items() if name in laws}
        self.slots = (Slot(name="main_lens_diffraction", models=laws, saves_time=False).under(own),)
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
