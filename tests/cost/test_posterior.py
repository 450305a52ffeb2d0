"""Posteriors are not begun without time for what is held against them."""

from __future__ import annotations

import time
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import tradestudy
from tradestudy.calibration.uncertain_cameras import UncertainCamera
from tradestudy.cost.calibration import posterior_cost
from tradestudy.cost.measuring import Allowance

STUDIES = Path(__file__).parents[2] / "studies"


def test_without_time_for_three_posteriors_none_is_begun() -> None:
    definition = tradestudy.load(STUDIES / "calibration.yaml").definition
    part = definition.file.calibration
    assert part is not None
    name = next(name for name, camera in part.cameras.items() if camera.target is not None)
    camera = cast(UncertainCamera, SimpleNamespace(name=name))  # of one that is not begun nothing else is asked
    begin = time.perf_counter()
    found = posterior_cost(definition, part, camera, Allowance(seconds=10.0), lambda _step, _share: None, inferring=4.0)
    assert time.perf_counter() - begin < 1.0
    assert found.entries == ()
    assert "about 12 s" in found.left_out[0]
    assert "a larger --budget" in found.left_out[0]
