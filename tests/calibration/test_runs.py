"""Studies with calibration errors from their file to results and report."""

import numpy as np
import pytest

import tradestudy
from tests.calibration.conftest import STUDIES
from tests.calibration.test_posteriors import SMALL
from tradestudy.figures import build
from tradestudy.report.contents import compose_report
from tradestudy.report.document import Callout, Paragraph, Table, all_blocks, spans


def plain(text):
    return "".join(span.text for span in spans(text))


LEFT_OUT = (
    "raytrix-r5-calibrated",
    "stereo-65-calibrated",
    "stereo-65-uniform",
    "stereo-printed-calibrated",
    "stereo-printed",
    "stereo-printed-uniform",
)
REDUCED = (
    "calibration.distances=[0.15 m, 1 m, 5 m]",
    "calibration.budget=16384",
    "calibration.accuracy=2 %",
    "scene.distances={from: 100 mm, to: 10 m, points: 21}",
    "calibration.compare=[[raytrix-r5, stereo-65]]",
    *(f"calibration.cameras.{name}=null" for name in LEFT_OUT),
)


@pytest.fixture(scope="module")
def reduced():
    """The shipped study with fewer distances and without its inferred calibrations."""
    return tradestudy.load(STUDIES / "calibration.yaml", REDUCED).run().data


def test_moments_are_given_where_they_exist_and_nowhere_else(reduced):
    data = reduced["calibration"].to_dataset()
    exist = data["moments_exist"].values
    for name in ("mean", "bias", "standard_deviation"):
        assert np.array_equal(np.isfinite(data[name].values), exist)
    assert exist.any()
    assert not exist.all()
    normal = data.sel(camera="stereo-65", field="axis", way="both")
    assert float(normal["moments_end"]) == pytest.approx(4.77, rel=0.02)
    assert normal["depth_quantile"].notnull().all()


def test_readings_without_a_rank_are_counted_by_cause(reduced):
    data = reduced["calibration"].to_dataset().sel(way="both", field="edge")
    near = data.sel(camera="stereo-65", distance=0.15)
    assert float(near["failed_fraction"].sel(cause="no_overlap")) == 1.0
    assert str(near["status"].item()) == "unranked"
    assert near["depth_quantile"].isnull().all()
    total = data["failed_fraction"].sum("cause")
    assert ((total == 0) | (total == 1)).all()


def test_the_propagated_uncertainty_is_that_of_the_closed_form_on_the_axis(reduced):
    """The study's own errors in closed form at the computed distances; the other errors here add little on the axis."""
    depth = reduced["depth"].to_dataset().sel(camera="stereo-65").sel(way="both")
    found = reduced["calibration"].to_dataset().sel(camera="stereo-65", way="both", field="axis")
    expected = np.interp(1.0, depth["distance"].values, depth["depth_uncertainty"].values)
    assert float(found["depth_uncertainty"].sel(distance=1.0)) == pytest.approx(expected, rel=0.03)


def test_sources_drive_depth_where_physics_says(reduced):
    data = reduced["sensitivity"].to_dataset()
    axis, edge = (data.sel(field=field, distance=1.0)["source_uncertainty"] for field in ("axis", "edge"))
    assert str(axis["source"].values[int(np.nanargmax(axis.sel(camera="stereo-65").values))]) == "yaw"
    # Pitch, roll and distortion act off the axis, field curvature and tilt of the array too.
    for camera, names in (
        ("stereo-65", ("pitch", "roll", "left_distortion_k1")),
        ("raytrix-r5", ("field_curvature", "array_tilt_x", "depth_distortion")),
    ):
        for name in names:
            there = [float(u.sel(camera=camera, source=name)) for u in (axis, edge)]
            assert there[1] > 20 * there[0]
    assert str(data["source_class"].sel(camera="raytrix-r5", source="pressure_change").item()) == "per session"


def test_the_verdict_has_probabilities_and_answers(reduced):
    decision = reduced["decision"].to_dataset()
    total = decision["rank_first"] + decision["rank_second"]
    assert (total <= 1.0 + 1e-12).all()
    singles = decision.sel(pair="raytrix-r5 vs stereo-65", rank_way="both", field="axis")
    assert (
        float(singles["rank_first"].sel(rank_distance=1.0))
        < 0.3
        < 0.5
        < float(singles["rank_first"].sel(rank_distance=0.15))
    )
    crossing = singles["equal_distance"].values
    assert np.isfinite(crossing).sum() == 1
    assert 0.0 < float(singles["equal_distance_error"].values[0]) < 0.01 * crossing[0]
    answers = dict(zip(decision["stability"].values, decision["stability_value"].values, strict=True))
    assert np.isnan(answers["array-at-300mm"])
    assert answers["array-at-300mm-calibration"] > 1e-6
    assert answers["yaw-at-half-metre"] > np.radians(0.2) > answers["yaw-at-half-metre-calibration"]


def test_the_report_obeys_its_rules(reduced):
    drawings = build(reduced)
    assert {"calibration-bands", "failure-share", "tornado", "sobol-indices", "rank-probability"} <= set(drawings)
    for name in ("calibration-bands", "failure-share", "tornado", "sobol-indices", "rank-probability"):
        assert drawings[name].draw().svg().startswith(b"<?xml")
    blocks = tuple(all_blocks(compose_report(reduced, {}, drawings).blocks))
    tables = {block.name: block for block in blocks if isinstance(block, Table)}
    interval = tables["calibration-table"]
    heads = [plain(row[0]) for row in interval.rows if len(row) == 1]
    assert "R5, on the axis" in heads
    far = [row for row in interval.rows if len(row) > 1 and plain(row[0]) == "5\N{NO-BREAK SPACE}m"]
    without = [row for row in far if plain(row[6]) == "—"]
    assert without  # no standard deviation beyond where it exists, yet quantiles
    assert all(plain(row[2]) for row in without)
    classes = [plain(row[1]) for row in tables["class-table"].rows]
    assert classes[:3] == ["per measurement", "per rig and session", "together"]
    assert "correlated by +0.900" in "".join(plain(cell) for row in tables["refused-table"].rows for cell in row)


def test_an_unconverged_calibration_is_said_aloud_and_fails_a_strict_run(written):
    file = written(
        SMALL.replace("maximum_steps: 300", "maximum_steps: 100"), "  compare: []\n  questions: {}\n"
    )  # fmt: skip
    result = tradestudy.load(file, ["calibration.budget=4096", "calibration.distances=[1 m, 2 m]"]).run()
    assert any("rig: its calibration did not converge" in line for line in result.unmet_requirements)
    drawings = build(result.data)
    assert drawings["corner-rig"].draw().svg()
    assert drawings["trace-rig"].draw().svg()
    blocks = tuple(all_blocks(compose_report(result.data, {}, drawings).blocks))
    warnings = [block for block in blocks if isinstance(block, Callout) and block.tone == "warning"]
    assert [plain(warning.title) for warning in warnings] == ["Rig did not converge"]
    said = [plain(block.text) for block in all_blocks(warnings[0].blocks) if isinstance(block, Paragraph)]
    assert "too short" in said[0]
