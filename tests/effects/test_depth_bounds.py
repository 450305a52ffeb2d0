"""A sample of the campaign that forces every omission of random cameras."""

from __future__ import annotations

import numpy as np

from tests.campaigns.depth_bounds import audit


def test_forced_omissions_stay_within_their_bounds() -> None:
    found = list(audit(6, seed=11))
    assert {one.case.split()[0] for one in found} == {"stereo", "focused", "unfocused"}
    assert [one for one in found if not one.within] == []
    ratios = [one.bound / one.change for one in found if one.counts]
    assert len(ratios) > 30
    assert np.median(ratios) < 30.0
