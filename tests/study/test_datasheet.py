"""The data sheet of each camera against the depth table and closed forms."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import tradestudy
from tradestudy.answers.datasheet import datasheet_group
from tradestudy.depth.evaluation import depth_uncertainty

STUDIES = Path(__file__).parents[2] / "studies"


@pytest.fixture(scope="module")
def found() -> tuple[tradestudy.Study, tradestudy.Result]:
    study = tradestudy.load(STUDIES / "robot.yaml", ["scene.distances.points=30"])
    return study, study.run()


def test_a_sheet_has_three_to_five_distances_and_the_parts_of_the_uncertainty(found) -> None:
    study, result = found
    data = result.data["datasheet"].to_dataset()
    assert data["sheet_distance"].values.tolist() == [0.5, 1.0, 2.0]
    definition = study.plan().study
    for name, camera in definition.case.cameras.items():
        one = data.sel(camera=name)
        for variable, error_source in (("z_accuracy", "calibration"), ("temporal_noise", "noise")):
            np.testing.assert_allclose(
                one[variable].values, depth_uncertainty(camera, data["sheet_distance"].values, error_source), rtol=1e-12
            )


def test_the_field_of_a_head_is_that_of_its_sensor(found) -> None:
    data = found[1].data["datasheet"].to_dataset().sel(camera="stereo-75mm")
    behind = 2.65e-3  # the principal distance, from which overlap and depth follow too; not the focused image distance
    assert float(data["horizontal_field_of_view"]) == pytest.approx(2.0 * np.arctan(1280 * 3e-6 / (2.0 * behind)))
    np.testing.assert_allclose(data["field_height"].values, 800 * 3e-6 * data["sheet_distance"].values / behind)


def test_fill_is_the_share_seen_by_both_views_and_nan_where_nothing_is_usable(found) -> None:
    data = found[1].data["datasheet"].to_dataset()
    head = data.sel(camera="stereo-75mm")
    behind = 1.0 / (1.0 / 2.65e-3 - 1.0)
    overlap = 1.0 - behind * 75e-3 / (1280 * 3e-6 * data["sheet_distance"].values)
    np.testing.assert_allclose(head["fill_rate"].values, overlap, rtol=1e-3)
    far = data.sel(camera="raytrix-r5", sheet_distance=2.0)
    assert float(far["usable"]) == 0.0
    assert float(far["fill_rate"]) == 0.0
    assert 1.7 < float(data["far_limit"].sel(camera="raytrix-r5")) < 1.9


def test_a_camera_measures_nothing_where_no_point_is_seen_twice() -> None:
    """At 90 mm the R5 sees no point behind two microlenses of a type."""
    study = tradestudy.load(STUDIES / "robot.yaml", ["decision.at=[90 mm, 0.5 m, 1 m]"])
    one = datasheet_group(study.plan().study).sel(camera="raytrix-r5")
    for variable in ("z_accuracy", "temporal_noise", "subpixel_rms", "plane_fit_rms"):
        assert np.isnan(one[variable].values).tolist() == [True, False, False], variable
    assert float(one["fill_rate"][0]) == 0.0
