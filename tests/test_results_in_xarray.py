"""Results as xarray, CF conventions and plots expect them: short names, errors that are linked, units, labels."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
import pytest
import xarray as xr

import tradestudy
from tradestudy import api
from tradestudy.results import coordinate_names

FEW = ("scene.distances.points=9",)


@pytest.fixture(scope="module")
def starter(tmp_path_factory: pytest.TempPathFactory) -> xr.DataTree:
    path = tmp_path_factory.mktemp("starter") / "starter.yaml"
    path.write_text(tradestudy.starter("starter"), encoding="utf-8")
    return api.load(path, FEW).run().data


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> xr.DataTree:
    path = tmp_path_factory.mktemp("swept") / "swept.yaml"
    text = "\nsweep: {stereo.baseline: [0.1 m, 200 mm], plenoptic.depth.disparity_error: [0.2 px]}\n"
    path.write_text(tradestudy.starter("swept") + text, encoding="utf-8")
    result = api.load(path, FEW).run()
    return tradestudy.open_result(result.write(path.parent / "run", pdf=False)).data


@pytest.mark.parametrize("study", ["starter", "swept"])
def test_every_variable_has_a_short_name_a_comment_and_its_error(study: str, request: pytest.FixtureRequest) -> None:
    linked = set()
    for node in request.getfixturevalue(study).children.values():
        for name, variable in node.to_dataset().variables.items():
            assert 0 < len(variable.attrs["long_name"]) <= 40, name
            assert name in node.coords or {"comment", "units"} <= variable.attrs.keys(), name
            if error := variable.attrs.get("ancillary_variables"):
                assert node[error].attrs["units"] in (variable.attrs["units"], "1"), name
                linked.add((name, error))
    assert ("depth_uncertainty", "depth_uncertainty_error") in linked
    assert ("usable_near", "usable_near_error") in linked


def test_relative_uncertainty_is_that_of_the_depth_over_the_distance(starter: xr.DataTree) -> None:
    for group in ("depth", "depth_at_places"):
        data = starter[group].to_dataset()
        expected = (data["depth_uncertainty"] / data["distance"]).transpose(*data["relative_uncertainty"].dims)
        np.testing.assert_allclose(data["relative_uncertainty"], expected, rtol=1e-15)


def test_a_design_of_a_sweep_is_chosen_by_the_last_word_of_its_path(swept: xr.DataTree, starter: xr.DataTree) -> None:
    depth = swept["depth"].to_dataset()
    assert depth["depth_uncertainty"].dims[:2] == ("baseline", "disparity_error")
    assert depth["baseline"].attrs["path"] == "stereo.baseline"
    assert (depth["baseline"].attrs["units"], depth["disparity_error"].attrs["units"]) == ("m", "px")
    # Disparity is proportional to the baseline.
    disparity = depth["disparity_px"].sel(camera="stereo", disparity_error=0.2)
    np.testing.assert_allclose(disparity.sel(baseline=0.2), 2.0 * disparity.sel(baseline=0.1), rtol=1e-12)
    declared = {name: depth[name].attrs["declared"] for name in ("baseline", "disparity_error")}
    assert declared == {"baseline": 0.3, "disparity_error": 0.1}
    as_declared = depth["depth_uncertainty"].sel(declared).drop_vars(list(declared))
    xr.testing.assert_allclose(as_declared, starter["depth"]["depth_uncertainty"], rtol=1e-12)


def test_swept_parameters_have_the_shortest_names_that_nothing_else_has() -> None:
    assert coordinate_names(["a.baseline", "b-1.baseline", "a.lenses.focal_length"]) == [
        "a_baseline",
        "b_1_baseline",
        "focal_length",
    ]
    assert coordinate_names(["a.distance", "a.focus.distance"]) == ["a_distance", "focus_distance"]
    assert coordinate_names(["a.b", "c.a.b"]) == ["a.b", "c_a_b"]  # no short name distinguishes the first
    assert coordinate_names(["a-b.yaw", "a_b.yaw"]) == ["a-b.yaw", "a_b.yaw"]


def test_a_plot_over_distance_is_presentable(starter: xr.DataTree) -> None:
    uncertainty = starter["depth"]["depth_uncertainty"]
    uncertainty.plot.line(x="distance")
    axes = plt.gca()
    legend = axes.get_legend()
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("object distance [m]", "depth uncertainty [m]")
    assert legend is not None
    assert legend.get_title().get_text() == "camera"
    assert [text.get_text() for text in legend.get_texts()] == uncertainty["camera"].values.tolist()
    plt.close()
