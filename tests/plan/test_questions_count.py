"""Every distance, error source and limit that a study's questions use is looked at before calibration is simplified."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tradestudy
from tradestudy.depth.evaluation import distribution

STUDIES = Path(__file__).parents[2] / "studies"
NONE = {"yaw": None, "pitch": None, "roll": None, "baseline": None, "focal_length": None}
CLAIM = {
    "says": "the pair is more certain", "source": "nobody", "tolerance_reason": "none", "under": "all",
    "quantity": "uncertainty_ratio", "camera": "pair", "against": "bare", "over": ["19 m", "20 m"],
    "expect": {"below": "3.4"},
}  # fmt: skip
QUESTION = {
    "says": "which yaw?", "vary": "pair.calibration.errors.yaw.half_width", "low": "0.005 deg", "high": "0.02 deg",
    "camera": "pair", "relative": "3 %", "at": "20 m",
}  # fmt: skip
RANGE = ("vary", "low", "high")
WEIGHED = {"quantity": "depth_uncertainty", "at": "20 m", "worst": "1 m", "best": "1 mm"}
STUDY = """\
format: 2
study: questions
title: A pair
question: What do its questions use?
cameras:
  pair: {{from: {studies}/cameras/stereo-100mm.yaml, depth: {{disparity_error: 0.1 px}}}}
  bare: {{from: {studies}/cameras/stereo-100mm.yaml, baseline: 50 mm}}
scene:
  distances: {{from: 0.1 m, to: 0.5 m, points: 12}}
  wavelength: 550 nm
  picture:
    texture: {{contrast: 15 %, correlation_length: 2 mm}}
    matching_window: 15 px
    light: {{electrons: 4000 electrons, at_f_number: 8}}
    read_noise: 10 electrons
    full_well: 20000 electrons
    bit_depth: 12
    spectrum: [{{wavelength: 500 nm, weight: 1}}, {{wavelength: 600 nm, weight: 1}}]
usable_range: {{relative_uncertainty: 10 %}}
"""
# A uniform yaw whose line is right within 1 % near by and 13 % off at 20 m.
FAR = {"yaw": {"standard_deviation": None, "half_width": "0.02 deg"}, "baseline": {"standard_deviation": "1 mm"}}
AT = "depth_uncertainty"


def study(folder: Path, errors: dict[str, Any], **more: Any) -> tradestudy.Study:
    file = folder / "questions.yaml"
    file.write_text(STUDY.format(studies=STUDIES.as_posix()), encoding="utf-8")
    values = {f"cameras.{name}.calibration.errors": NONE for name in ("pair", "bare")}
    values["cameras.pair.calibration.errors"] = NONE | errors
    return tradestudy.load(file).with_values(values | more)


def propagation(found: tradestudy.Study) -> str:
    return found.plan().models("pair")["calibration"]


def test_at_close_range_the_linear_model_is_enough(tmp_path: Path) -> None:
    assert propagation(study(tmp_path, FAR)) == "linear"


def test_a_claim_far_beyond_the_scene_counts(tmp_path: Path) -> None:
    asked = study(tmp_path, FAR, claims={"far": CLAIM})
    assert propagation(asked) == "exact"
    assert asked.run().data["claims"]["met"].values[0, 0] == 0  # 3.69 by draws; a line makes it 3.22


@pytest.mark.parametrize(
    "asked",
    [
        {"decision": {"between": ["pair", "bare"], "at": ["20 m"]}},
        {"sensitivity": {"at": ["20 m"]}},
        {"value_of_information": {"assumptions": {"yaw": {k: QUESTION[k] for k in RANGE}}, "at": ["20 m"]}},
        {"solve": {"far": QUESTION}},
        {"trade_off": {"criteria": {"far": WEIGHED}}},
        {"requirements": {"far": {"says": "far", "camera": "any", "usable": {"at": "20 m"}}}},
        {"claims": {"far": CLAIM}},
        {"claims": {"far": CLAIM | {"quantity": "share_better", "expect": {"below": "5 %"}}}},
    ],
)
def test_draws_converge_at_the_distances_of_every_question(tmp_path: Path, asked: dict[str, Any]) -> None:
    forced = {"effects.calibration": "exact", "accuracy.tolerance": "1 %"}
    pair = study(tmp_path, FAR, **asked, **forced).plan().study.case.cameras["pair"]
    assert distribution(pair, np.array([20.0]), "both").sampling_error()[0] <= 0.01  # 1.7 % with the scene's draws


def test_the_farthest_of_many_questions_counts(tmp_path: Path) -> None:
    near = {
        f"r{k}": {"says": "near", "camera": "any", AT: {"below_relative": "2 %", "over": [f"0.{k} m", f"0.{k}1 m"]}}
        for k in range(31, 36)
    }
    asked = study(tmp_path, FAR, solve={"far": QUESTION}, requirements=near)
    definition = asked.plan().study.under("far")
    assert definition.case.cameras["pair"].propagation.model == "exact"


def test_a_question_about_calibration_alone_is_judged_by_it(tmp_path: Path) -> None:
    """Noise hides what a line makes of a uniform yaw; asked for calibration alone it is 18 % off."""
    question = QUESTION | {"low": "0.0001 deg", "high": "0.0006 deg", "relative": "0.005 %", "at": "0.4 m"}
    narrow = {"yaw": {"standard_deviation": None, "half_width": "0.0004 deg"}}
    assert propagation(study(tmp_path, narrow)) != "exact"
    assert propagation(study(tmp_path, narrow, solve={"own": question | {"errors": "calibration"}})) == "exact"


@pytest.mark.parametrize("tolerance", ["5 %", "10 %"])
def test_failures_that_calibration_adds_end_a_usable_range(tmp_path: Path, tolerance: str) -> None:
    values = {
        "scene.distances": ["800 m", "805 m", "810 m"],
        "usable_range": {"failed_fraction": "0.01 %"},
        "accuracy.tolerance": tolerance,
    }
    found = study(tmp_path, {"yaw": {"standard_deviation": "0.0005 deg"}}, **values)
    usable, exact = (
        one.run().data["depth"]["usable"].sel(camera="pair").values
        for one in (found, found.with_values({"effects.calibration": "exact"}))
    )
    np.testing.assert_array_equal(usable, exact)
    assert not exact.any()


def test_readings_may_derive_the_disparity_error_or_take_the_spectrum_back(tmp_path: Path) -> None:
    derived = {"derived": {"says": "derived", "set": {"pair.depth.disparity_error": "derived"}}}
    problem = next(one for one in study(tmp_path, FAR, readings=derived).plan().problems if one.name == "pair")
    assert problem.models["defocus_blur"] == "disc"
    grey = {"grey": {"says": "one colour", "set": {"scene.picture.spectrum": None}}}
    found = study(tmp_path, FAR, readings=grey, **{"cameras.pair.depth.disparity_error": "derived"}).plan()
    assert found.study.readings["grey"].case.cameras["pair"].disparity_error_px.models.spectrum == "off"


def test_cameras_without_errors_are_ranked_with_others_when_draws_are_forced(tmp_path: Path) -> None:
    decision = {"between": ["pair", "bare"], "at": ["0.3 m"]}
    ran = study(tmp_path, FAR, decision=decision, effects={"calibration": "exact"}).run()
    chance = ran.data["decision"]["rank_first"].values
    assert np.all((chance >= 0.0) & (chance <= 1.0))
    plain = study(tmp_path, {}, effects={"calibration": "exact"}).plan()
    assert plain.models("pair")["calibration"] in ("exact", "off")
    assert "no calibration errors are declared" in study(tmp_path, {}).plan().text()
