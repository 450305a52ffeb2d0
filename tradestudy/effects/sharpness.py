"""Diffraction in what counts as sharp: the spot beside the blur, or the blur alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from tradestudy.cameras.focus import BlurCriterion, Focus
from tradestudy.effects.base import COMPLETE, OFF, Bound, EffectCriterion, Model, Slot
from tradestudy.optics.arrays import FloatArray


def diffraction_of_sharpness(focuses: Sequence[Focus], criteria: Sequence[BlurCriterion]) -> Slot:
    """Whether criteria that allow for the diffraction spot do so; what the ends of all sharp ranges move otherwise.

    Both are closed forms, so that the bound is the largest change itself: infinite where an end appears or vanishes.
    """
    allowing = [one for one in criteria if one.measure != "none"]
    if not allowing:
        return Slot(name="main_lens_diffraction", models=(Model(name=OFF, bounds={"depth_of_field": COMPLETE}),))
    pairs = [
        [focus.sharp_range(one).slices for one in (criterion, replace(criterion, measure="none"))]
        for focus in focuses
        for criterion in allowing
    ]
    ends = [[np.atleast_1d(getattr(one, end)) for one in pair] for pair in pairs for end in ("near", "far")]
    change = max((_largest(geometric, own) for own, geometric in ends), default=0.0)
    return Slot(
        name="main_lens_diffraction",
        models=(
            Model(
                name=OFF,
                bounds={
                    "depth_of_field": Bound(
                        relative_change=change,
                        criterion=EffectCriterion(
                            words="largest change of a near or far end",
                            definition="|end without the diffraction spot/end with it − 1|, the largest over cameras, "
                            "criteria and both ends; infinite where an end appears or vanishes",
                            value=change,
                        ),
                        reason="without the diffraction spot all of the allowed blur is left to defocus; both are "
                        "closed forms, so that this is the change itself",
                    )
                },
            ),
            Model(name="airy", bounds={"depth_of_field": COMPLETE}),
        ),
    )


def _largest(simple: FloatArray, complete_one: FloatArray) -> float:
    """Largest relative difference; infinite where only one of two is finite."""
    if simple.shape != complete_one.shape:
        return math.inf
    same = (simple == complete_one) | (np.isnan(simple) & np.isnan(complete_one))
    with np.errstate(invalid="ignore"):  # ∞/∞ where both are infinite, which is the same
        change = np.where(same, 0.0, np.abs(simple / complete_one - 1.0))
    return float(np.max(np.where(np.isnan(change), math.inf, change), initial=0.0))
