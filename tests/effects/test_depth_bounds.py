"""Samples of the campaigns that force every omission of random cameras, and cases that were hard for them."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import dblquad

from tests.campaigns import depth_of_field_bounds
from tests.campaigns.depth_bounds import audit, omissions
from tests.campaigns.depth_cases import base_study


def test_forced_omissions_stay_within_their_bounds() -> None:
    found = list(audit(6, seed=11))
    assert {one.case.split()[0] for one in found} == {"stereo", "focused", "unfocused"}
    assert [one for one in found if not one.within] == []
    ratios = [one.bound / one.change for one in found if one.counts and math.isfinite(one.change)]
    assert len(ratios) > 30
    assert np.median(ratios) < 30.0


# Distances end [mm] ever closer to where the far end of depth is lost: points in place of pixels double the disparity
# error everywhere, and multiply the depth uncertainty there by 1 and at least so much.
@pytest.mark.parametrize(("end", "least"), [(350.0, 1.5), (436.0, 4.0), (470.0, 10.0)])
def test_an_omission_is_bounded_where_the_far_end_of_depth_runs_away(tmp_path: Path, end: float, least: float) -> None:
    values = {
        "scene.distances.from": "156.6 mm",
        "scene.distances.to": f"{end} mm",
        "scene.wavelength": "464.7 nm",
        "scene.temperature.deviation": "12.3 K",
        "scene.picture.texture.contrast": "9 %",
        "scene.picture.texture.correlation_length": "1.5 mm",
        "scene.picture.window": "23 px",
        "scene.picture.light.electrons": "2488 electrons",
        "scene.picture.light.at_f_number": 9.4,
        "scene.picture.read_noise": "13 electrons",
        "scene.picture.bits": 14,
        "cameras.one.main_lens.focal_length": "6 mm",
        "cameras.one.main_lens.f_number": 9.4,
        "cameras.one.focus.distance": "176.5 mm",
    }
    found = list(omissions("far end", base_study("unfocused", tmp_path).with_values(values)))
    assert [one for one in found if not one.within] == []
    (pixels,) = [one for one in found if one.slot == "pixel_integration"]
    assert least < pixels.change <= pixels.bound


@pytest.mark.parametrize("fall", [0.003, 0.03])
def test_amplitude_that_falls_towards_the_rim_moves_the_transfer_by_at_most_its_fall(fall: float) -> None:
    def pupil_with_itself(s: float) -> float:
        """Product of amplitudes 1 − ε r² a shift 2 s apart, over a quarter of the lens where both are."""
        found, _ = dblquad(
            lambda y, x: (1 - fall * ((x + s) ** 2 + y**2)) * (1 - fall * ((x - s) ** 2 + y**2)),
            0.0, 1.0 - s, 0.0, lambda x: math.sqrt(max(1.0 - (x + s) ** 2, 0.0)),
        )  # fmt: skip
        return found

    def uniform(s: float) -> float:
        return (math.acos(s) - s * math.sqrt(1.0 - s * s)) / 2.0

    at_rest = pupil_with_itself(0.0) / uniform(0.0)
    changes = [pupil_with_itself(s) / uniform(s) / at_rest - 1.0 for s in (0.2, 0.5, 0.8, 0.95)]
    assert max(map(abs, changes)) < fall * (1.0 + fall)
    assert max(map(abs, changes)) > fall / 2.0


def test_what_is_sharp_without_the_diffraction_spot_stays_within_its_bound() -> None:
    found = depth_of_field_bounds.audit(40, seed=11)
    assert {one.kind for one in found} == set(depth_of_field_bounds.KINDS)
    assert [one for one in found if not one.within] == []
    assert sum(one.counts for one in found) > 15
    assert np.median([one.bound / one.change for one in found if one.counts]) < 30.0
    assert max(one.off_roots for one in found) < 1e-12
