"""The diffraction spot in the depth of field: kept, unless the study leaves it out; then told what that changes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tradestudy
from tradestudy.cameras.focus import BlurCriterion
from tradestudy.plan.pieces.depth_of_field import NAME

STUDIES = Path(__file__).parents[2] / "studies"


def test_the_spot_stays_and_leaving_it_out_moves_the_ends_as_the_closed_forms_say() -> None:
    kept = tradestudy.load(STUDIES / "hand_lens.yaml").plan()
    assert kept.models(NAME) == {"main_lens_diffraction": "airy"}
    forced = tradestudy.load(STUDIES / "hand_lens.yaml", ["effects.main_lens_diffraction=off"]).plan()
    piece = next(one for one in forced.pieces if one.name == NAME)
    assert piece.models == {"main_lens_diffraction": "off"}
    change = piece.by_forcing["depth_of_field"].relative
    case, asked = forced.definition.case, forced.definition.file.depth_of_field
    assert asked is not None
    moved = []
    for camera in case.all_cameras.values():
        for part in asked.criteria.values():
            criterion = part.criterion(case.wavelength)
            if criterion.measure == "none":
                continue
            bare = BlurCriterion(blur_px=criterion.blur_px, measure="none", wavelength=case.wavelength)
            own, without = (camera.focus.sharp_range(one).slices for one in (criterion, bare))
            if own.near.shape != without.near.shape:
                moved.append(np.inf)
                continue
            with np.errstate(invalid="ignore"):
                moved += [float(np.nanmax(np.abs(without.near / own.near - 1.0), initial=0.0))]
    assert change >= max(moved) > 0.0 or change == pytest.approx(np.inf)
