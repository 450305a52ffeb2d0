"""What cannot be answered is refused or left empty, and says so; what can be is followed beyond the study."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from tests.cameras.builders import r5, stereo
from tests.study.conftest import STUDIES
from tradestudy.answers.claims import claim_value
from tradestudy.api import Study, load
from tradestudy.cameras.declaration import PixelCount
from tradestudy.cameras.depth_camera import UsableCriteria
from tradestudy.depth.evaluation import evaluate_depth
from tradestudy.depth.usable import evaluate_limits
from tradestudy.errors import StudyError
from tradestudy.study.document import Value

HEADLINE = STUDIES / "plenoptic_vs_stereo.yaml"


def test_a_camera_file_is_no_study(tmp_path: Path) -> None:
    camera = tmp_path / "camera.yaml"
    camera.write_text("kind: stereo\nbaseline: 50 mm\n", encoding="utf-8")
    with pytest.raises(StudyError) as caught:
        load(camera)
    assert [problem.what.partition(";")[0] for problem in caught.value.problems] == ["this is a camera, not a study"]


@pytest.mark.parametrize(
    ("override", "reported"),
    [
        ("sweep={scene.distances.from: [50 mm, 500 mm]}", "cannot be swept"),
        ("sweep={stereo-short.baseline: {from: 0 mm, to: 5 mm, points: 3, spacing: log}}", "log range from '0 mm'"),
        (
            "sweep={stereo-short.baseline: {from: 10 mm, to: 30 mm, points: 200}, "
            "stereo-short.lenses.focal_length: {from: 5 mm, to: 9 mm, points: 200}}",
            "sweep: points of the sweep: 40",
        ),
        ("sweep={stereo-short.sensor.pixels.0: {from: 1000, to: 1100, points: 4}}", "a whole number is expected"),
        ("sweep={raytrix-r5.depth.estimator: [adjacent-pair, unknown, widest-pair]}", "'unknown' is unknown"),
        ("claims.C2.expect.below=1 m", "claims.C2.expect: '1 m' is a length"),
        ("claims.C1.expect.about=0.5", "'0.5' has no unit"),
        ("solve.yaw-at-half-metre.low=6 deg", "0 < low < high < ∞"),
        ("decision.between=[stereo-short, stereo-short]", "two different cameras"),
        (
            "stereo-short.calibration.errors.baseline="
            "{standard_deviation: null, shape: student-t, scale: 1 um, degrees_of_freedom: 0.5}",
            "'0.5' is out of range; a plain number of 1 or more is expected",
        ),
        ("claims.C2.over=[10 m, 0.5 m]", "from near to far"),
        ("usable_range.overlap=120 %", "from 0 % to 100 %"),
        ("raytrix-r5.calibration.correlations.mla_distance.focal_length=true", "'true' is not a quantity"),
        ("stereo-short.sensor.pixel_pitch=1e6 m", "pixel pitch of a sensor; check its unit; 10 nm to 5 mm"),
        ("stereo-short.baseline=1e-9 m", "baseline of two cameras"),
        ("stereo-short.lenses.f_number=1e-300", "'1e-300' is out of range; a number from 1e-30 to 1e30 in SI units is"),
        ("scene.distances=[0.4 m]", "1 value is given; at least 2 are expected"),
    ],
)
def test_check_refuses(override: str, reported: str) -> None:
    with pytest.raises(StudyError) as caught:
        load(HEADLINE, (override,))
    assert reported in str(caught.value)


def test_a_mistake_of_a_reading_names_the_reading() -> None:
    with pytest.raises(StudyError, match="in reading 'adjacent-pair'"):
        load(HEADLINE, ("raytrix-r5.depth.estimator=least-squares", "raytrix-r5.depth.microlenses=all"))


def test_notes_belong_to_the_study() -> None:
    same, other = (
        load(HEADLINE, (f"stereo-short.baseline={{value: 20 mm, note: {note}}}",)) for note in ("one", "two")
    )
    assert same.hash != other.hash


@pytest.mark.parametrize(("start", "stop"), [("450 mm", "10 m"), ("50 mm", "10 m"), ("2 m", "10 m")])
def test_limits_are_followed_beyond_the_distances_of_the_study(start: str, stop: str) -> None:
    study = load(HEADLINE, (f"scene.distances.from={start}", f"scene.distances.to={stop}"))
    claim = study.file.claims["C1"]
    assert claim_value(claim, study.prepared.case) == pytest.approx(
        0.1 / (0.4 * math.tan(math.radians(32.62))), rel=1e-9
    )


def test_a_far_end_beyond_any_study_is_found(headline: Study) -> None:
    values = {
        "scene.distances.to": "1000 km",
        "stereo-65-across.baseline": "50 m",
        "stereo-65-across.sensor.pixel_pitch": "1 um",
        "usable_range.disparity_step": "5 px",
        "claims.C4.camera": "stereo-65-across",
    }
    study = headline.with_values(values)
    # f B / step, with f from 65.24° across 1024 pixels of 1 µm.
    f = 1.024e-3 / (2 * math.tan(math.radians(32.62)))
    assert claim_value(study.file.claims["C4"], study.prepared.case) == pytest.approx(f * 50 / 5e-6, rel=1e-9)


def test_nothing_is_known_where_there_is_no_image() -> None:
    for camera, f in ((r5(), 12.5e-3), (stereo(), 30.5e-3)):
        evaluation = evaluate_depth(camera, np.array([0.5 * f, f, 0.5]))
        assert np.isnan(evaluation.uncertainty[:, :2]).all()
        assert np.isnan(evaluation.failed_fraction[:, :2]).all()
        assert np.isfinite(evaluation.uncertainty[:, 2]).all()
        limits = evaluate_limits(camera, UsableCriteria(blur_px=1e9), np.array([0.5 * f, f, 0.5]))
        assert limits["real_image"].met.tolist() == [False, False, True]


@pytest.mark.parametrize("distances", [("400 mm", "2 m"), ["400 mm", "2 m"], "[400 mm, 2 m]"])
def test_lists_may_be_given_as_python_has_them(distances: Value) -> None:
    study = load(HEADLINE).with_values({"scene.distances": distances})
    assert study.prepared.case.distance.tolist() == [0.4, 2.0]


def test_mappings_may_be_given_as_python_has_them() -> None:
    study = load(HEADLINE).with_values({"scene.distances": {"from": "1 m", "to": "2 m", "points": 3}})
    assert study.prepared.case.distance[[0, -1]].tolist() == [1.0, 2.0]
    quoted = load(HEADLINE).with_values({"sweep": {"stereo-short.baseline": ["10 mm", "40 mm"]}})
    assert quoted.with_values({"title": '"it\'s: [one], #2"'}).file.title == "it's: [one], #2"


def test_a_path_that_is_not_text_is_refused_with_a_message() -> None:
    with pytest.raises(TypeError, match=r"'scene\.distances\.to', not 3"):
        load(HEADLINE).with_values({3: "1 m"})  # type: ignore[dict-item]  # the mistake that is tested


def test_distances_and_pixels_of_spacecraft_are_accepted() -> None:
    far = load(HEADLINE).with_values({"scene.distances": ["1 m", "1 au", "1e20 m"], "readings": {}, "claims": {}})
    for camera in far.prepared.case.cameras.values():
        depth = evaluate_depth(camera, far.prepared.case.distance)
        assert not np.isnan(depth.uncertainty).any()
    counts = TypeAdapter(PixelCount)
    assert counts.validate_python(1_000_000) == 1_000_000
    with pytest.raises(ValidationError, match="less than or equal to 1000000"):
        counts.validate_python(1_000_001)


@pytest.mark.parametrize("asked", ["check", "plan", "run"])
def test_a_target_that_no_view_shows_is_refused_before_sampling(asked: str) -> None:
    study = load(STUDIES / "calibration_plan.yaml", ["cameras.rig.calibration.target.spacing=1 m"])
    with pytest.raises(StudyError, match=r"calibration\.target: .*too few views: 0 \(allowed: at least 3"):
        getattr(study, asked)()


@pytest.mark.parametrize("asked", ["check", "plan", "run"])
@pytest.mark.parametrize(
    ("overrides", "reported"),
    [
        (["solve.board.high=400 mm"], r"solve\.board\.high: rig: .*too few views: [012] \(allowed: at least 3"),
        (
            ["solve=null", "sweep={rig.calibration.target.spacing: [25 mm, 1 m]}"],
            r"sweep: rig\.calibration\.target\.spacing=1 m: rig: .*too few views: 0 \(allowed: at least 3",
        ),
    ],
)
def test_a_target_that_too_few_planned_views_show_is_refused(asked: str, overrides: list[str], reported: str) -> None:
    few = "cameras.rig.calibration.target.views=5"
    study = load(STUDIES / "calibration_plan.yaml", [few, *overrides])
    with pytest.raises(StudyError, match=reported):
        getattr(study, asked)()


def test_check_and_plan_refuse_corners_that_contradict_the_rig() -> None:
    study = load(STUDIES / "real_rig.yaml", ["webcams.baseline=100 mm"])
    with pytest.raises(StudyError, match=r"declared baseline 100 mm, corners say 94\.1") as by_plan:
        study.plan()
    with pytest.raises(StudyError) as by_check:
        study.check()
    assert str(by_check.value) == str(by_plan.value)
