"""Samples of the campaigns that force every omission of random cameras."""

from __future__ import annotations

import numpy as np

from tests.campaigns import depth_of_field_bounds
from tests.campaigns.depth_bounds import audit


def test_forced_omissions_stay_within_their_bounds() -> None:
    found = list(audit(6, seed=11))
    assert {one.case.split()[0] for one in found} == {"stereo", "focused", "unfocused"}
    assert [one for one in found if not one.within] == []
    ratios = [one.bound / one.change for one in found if one.counts]
    assert len(ratios) > 30
    assert np.median(ratios) < 30.0


def test_what_is_sharp_without_the_diffraction_spot_stays_within_its_bound() -> None:
    found = depth_of_field_bounds.audit(40, seed=11)
    assert {one.kind for one in found} == set(depth_of_field_bounds.KINDS)
    assert [one for one in found if not one.within] == []
    assert sum(one.counts for one in found) > 15
    assert np.median([one.bound / one.change for one in found if one.counts]) < 30.0
    assert max(one.off_roots for one in found) < 1e-12
