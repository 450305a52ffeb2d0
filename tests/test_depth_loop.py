"""The loop from pictures of planes to depth, and from its errors to a matcher that tells those elsewhere."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tests.report.layout import unreadable
from tests.scene_studies import PAIR, PLENOPTIC, scene_study
from tradestudy import api, figures
from tradestudy.answers import depth_loop
from tradestudy.errors import StudyError
from tradestudy.execution import Threads
from tradestudy.execution.executor import heard_by
from tradestudy.imaging.picture import PictureDisparityError
from tradestudy.report.contents import compose_report
from tradestudy.report.document import Paragraph, Table, plain_text
from tradestudy.results.views.terminal import terminal_lines
from tradestudy.study.document import Value

pytestmark = pytest.mark.usefixtures("only_rays")

LOOP = """
depth_loop:
  distances: [140 mm, 150 mm, 165 mm]
  fitted_at: [150 mm]
  electrons: [2000 electrons, 8000 electrons]
  windows: 400
"""
DERIVED = {"pair.depth.disparity_error": "derived"}


def study(folder: Path, loop: str = LOOP) -> api.Study:
    pair = PAIR.format(
        name="pair", title="Pair", pixels="[220, 140]", baseline="10 mm", convergence="infinity", error="0.05 px"
    )
    text = scene_study(
        pair,
        "{shape: plane, distance: 150 mm}",
        distances="from: 120 mm, to: 200 mm, points: 3",
        window="7 px",
        light="at_f_number: 8",
    )
    path = folder / "loop.yaml"
    path.write_text(text[: text.index("  image:")] + loop, encoding="utf-8")
    return api.load(path).with_values(DERIVED)


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[api.Result, Path]:
    pytest.importorskip("cv2")
    folder = tmp_path_factory.mktemp("loop")
    return api.run(study(folder), folder / "out", pdf=False), folder


@pytest.fixture(scope="module")
def measured(ran: tuple[api.Result, Path]) -> xr.Dataset:
    return ran[0].data["depth_loop"].to_dataset().sel(camera="pair")


def test_the_matcher_fitted_at_one_distance_predicts_the_noise_at_others(measured: xr.Dataset) -> None:
    others = measured.sel(distance=[0.14, 0.165])
    assert np.all(measured["depth_windows"] >= 400)
    assert np.all(np.abs(others["over_matcher"] - 1.0) < 0.1 + 2.0 * others["over_matcher_error"])
    assert np.all(np.abs(measured["depth_bias_px"]) < 0.05)
    assert np.all(measured["depth_filled"] > 0.95)


def test_noise_is_not_less_than_the_derived_bound(measured: xr.Dataset) -> None:
    """The prediction is the Cramér–Rao bound of the picture, from its power spectrum and not from these textures."""
    over, error = measured["depth_relative_spread"], measured["depth_relative_spread_error"]
    assert np.all(over > 1.0 - 3.0 * error)
    assert np.all(over < 1.4)
    # What each window states, to first order, is up to a tenth too large: interpolation averages noise between pixels,
    # and the noise of the reference cancels against that of its own gradient (in dim light, a fifth of its square).
    assert np.all((measured["depth_over_bound"] > 0.88) & (measured["depth_over_bound"] < 1.3))


def test_four_times_the_light_halves_the_noise_of_depth(measured: xr.Dataset) -> None:
    """Read noise is small beside shot noise; what it adds lets the ratio exceed two a little."""
    ratio = measured["depth_spread"].sel(electrons=2000.0) / measured["depth_spread"].sel(electrons=8000.0)
    assert np.all((ratio > 1.8) & (ratio < 2.3))


@pytest.mark.slow
def test_the_matcher_fitted_to_near_micro_images_predicts_the_noise_in_far_ones() -> None:
    """At 4 m, pixel locking differs most between the three directions of the lattice."""
    shipped = api.load(Path(__file__).parents[1] / "studies" / "depth_loop.yaml")
    planes: dict[str, Value] = {
        "depth_loop.cameras": ["raytrix-r5"],
        "depth_loop.distances": ["0.2 m", "4 m"],
        "depth_loop.fitted_at": ["0.2 m"],
    }
    data = shipped.with_values(planes).run().data["depth_loop"].to_dataset().squeeze()
    assert np.all(data["depth_windows"] >= 1500)
    assert abs(float(data["over_matcher"].sel(distance=4.0)) - 1.0) < 0.1
    assert np.all(np.abs(data["depth_bias_px"]) < 0.02)


def test_the_compared_area_is_the_overlap_of_parallel_pictures(measured: xr.Dataset) -> None:
    available = measured["depth_available"].isel(electrons=0)
    assert available.values == pytest.approx(measured["predicted_availability"].isel(electrons=0).values, abs=0.02)


def test_the_matcher_is_written_as_a_study_takes_it(ran: tuple[api.Result, Path], measured: xr.Dataset) -> None:
    from ruamel.yaml import YAML

    result, folder = ran
    written = YAML(typ="safe").load((folder / "out" / "matchers.yaml").read_text(encoding="utf-8"))
    says = written["cameras"]["pair"]["depth"]["matcher"]
    values: dict[str, Value] = {f"pair.depth.matcher.{name}": value for name, value in says.items()}
    law = study(folder).with_values(values).prepared.case.cameras["pair"].disparity_error_px
    assert isinstance(law, PictureDisparityError)
    for name in ("factor", "floor", "false_matches"):
        assert getattr(law.matcher, name) == pytest.approx(float(measured[f"matcher_{name}"]), rel=0.05, abs=1e-9)
    assert result.data["depth_loop"]["fitted"].values.tolist() == [0.0, 1.0, 0.0]


def test_noise_is_predicted_where_wide_lenses_dim_the_overlap_and_enough_pictures_are_taken(
    tmp_path: Path,
) -> None:
    """The views share a fifth of their pictures, at the edges, where cos⁴θ leaves 60 % of the light and more noise."""
    pytest.importorskip("cv2")
    wide = DERIVED | {
        "pair.sensor.pixels": [320, 200],
        "pair.sensor.pixel_pitch": "32 um",
        "pair.baseline": "145 mm",
        "scene.picture.texture.correlation_length": "1.7 mm",
        "depth_loop.windows": 850,
    }
    loaded = study(tmp_path).with_values(wide)
    assert loaded.file.depth_loop is not None
    point = depth_loop.loop_points(loaded.prepared, loaded.file.depth_loop)["pair", 0.15, 0.15, 8000.0]
    told: list[float] = []
    with heard_by(told.append):
        found = depth_loop.measure_on_plane(point)
    assert told == sorted(told)
    assert sum(share < 0.95 for share in told) > 4  # every picture moves the progress
    assert found.score is not None
    assert found.available < 0.25
    sensor = point.camera.sensor
    windows_of_one = found.available * sensor.columns * sensor.rows / 49.0
    assert windows_of_one < 400
    assert found.score.windows >= 850
    assert found.score.windows < 850 + windows_of_one
    relative = found.errors_px / found.bounds_px
    # Noise of mid-picture would fall short by an eighth.
    assert np.std(relative) == pytest.approx(1.0, abs=4.0 / math.sqrt(2.0 * relative.size))
    # Pictures of one texture with the same noise would repeat their errors.
    assert np.unique(relative).size == relative.size


def test_results_do_not_depend_on_the_executor(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    few = study(tmp_path, LOOP.replace(", 165 mm", "").replace("2000 electrons, ", "").replace("400", "100"))
    alone, shared = (few.run(executor=executor).data["depth_loop"].to_dataset() for executor in (None, Threads(2)))
    assert np.all(alone["depth_measured"] > 0.0)
    xr.testing.assert_identical(shared, alone)


def test_every_plane_is_among_the_conclusions(ran: tuple[api.Result, Path], measured: xr.Dataset) -> None:
    planes = json.loads(json.dumps(ran[0].conclusions(), allow_nan=False))["measured"]
    assert len(planes) == 6
    for plane in planes:
        assert (plane["camera"], plane["of"]) == ("Pair", "plane")
        there = measured.sel(distance=plane["distance"], electrons=plane["electrons"]).squeeze()
        for name in ("spread", "spread_error", "bias", "bias_error", "predicted", "filled"):
            assert plane[name] == float(there[f"depth_{name}"])


@pytest.mark.parametrize("bias", [0.0009, 0.004, 0.03, 0.2, 3.0])
def test_the_figure_can_be_read_whatever_the_bias(ran: tuple[api.Result, Path], bias: float) -> None:
    tree = ran[0].data.copy(deep=True)
    values = tree["depth_loop"]["depth_bias_px"]
    values[...] = np.linspace(-bias, 0.3 * bias, values.size).reshape(values.shape)
    assert unreadable(figures.build(tree)["depth_loop"].draw()) == []


def test_curves_are_named_by_their_light_if_the_names_fit(ran: tuple[api.Result, Path]) -> None:
    tree = ran[0].data.copy(deep=True)

    def names() -> list[list[str]]:
        drawing = figures.build(tree)["depth_loop"]
        assert "Every light has marks of its own; the table below lists their values." in drawing.caption
        figure = drawing.draw()
        assert unreadable(figure) == []
        return [sorted(text.get_text() for text in panel.texts) for panel in figure.axes]

    assert names() == [["Pair, 2000 e⁻", "Pair, 8000 e⁻"]] * 4
    loop = tree["depth_loop"].to_dataset()
    more = [loop.assign_coords(electrons=loop["electrons"] + number) for number in range(10)]
    tree["depth_loop"] = xr.DataTree(xr.concat(more, "electrons", data_vars="minimal"))
    assert names() == [["Pair"]] * 4


def test_the_report_compares_prediction_and_achievement(ran: tuple[api.Result, Path]) -> None:
    tree = ran[0].data
    drawings = figures.build(tree)
    assert drawings["depth_loop"].draw().svg()
    report = compose_report(tree, ran[0].run_record, drawings)
    tables = {block.name: block for block in report.blocks if isinstance(block, Table)}
    assert len(tables["depth-loop-depth-table"].rows) == 7  # the camera, and its planes
    reported = [plain_text(block.text) for block in report.blocks if isinstance(block, Paragraph)]
    over = tree["depth_loop"]["depth_relative_spread"].values
    answer = f"The Pair measures planes with {over.min():.2g} to {over.max():.2g} times the predicted spread."
    assert report.headline == answer
    assert answer in list(terminal_lines(tree))
    assert any("matcher: {factor: " in text and "On 4 planes" in text for text in reported)


@pytest.mark.parametrize(
    ("loop", "message"),
    [
        (
            LOOP.replace("fitted_at: [150 mm]", "fitted_at: [151 mm]"),
            "depth_loop.fitted_at.0: is not one of the distances",
        ),
        (LOOP.replace("165 mm", "145 mm"), "depth_loop.distances.2: distances must increase"),
        (LOOP + "  cameras: [pear]", "depth_loop.cameras.0: no camera is called 'pear'; nearest: 'pair'"),
    ],
)
def test_mistakes_are_reported_at_their_place(tmp_path: Path, loop: str, message: str) -> None:
    with pytest.raises(StudyError) as refused:
        study(tmp_path, loop)
    assert message in str(refused.value)


@pytest.mark.parametrize("electrons", ["60000 electrons, 2000 electrons", "2000 electrons, 60000 electrons"])
def test_light_that_saturates_is_refused_wherever_it_is_listed(tmp_path: Path, electrons: str) -> None:
    """A lens of 8 mm focused at 150 mm works at f/8.451, where 60 000 electrons at f/8 are 60 000 (8/8.451)²."""
    pytest.importorskip("cv2")
    loop = LOOP.replace("2000 electrons, 8000 electrons", electrons)
    with pytest.raises(StudyError, match=r"depth_loop: the pictures of pair would be saturated: 53800 e") as refused:
        study(tmp_path, loop).check()
    assert len(refused.value.problems) == 1


def test_results_without_a_measurement_give_the_reason(tmp_path: Path) -> None:
    """Nearer than the rig's views overlap; no matcher follows."""
    pytest.importorskip("cv2")
    loop = LOOP.replace("[140 mm, 150 mm, 165 mm]", "[24 mm, 150 mm]").replace("[150 mm]", "[24 mm]")
    loop = loop.replace("2000 electrons, ", "").replace("400", "100")
    data = study(tmp_path, loop).run().data["depth_loop"].to_dataset().sel(camera="pair")
    assert np.all(data["depth_measured"].sel(distance=0.024) == 0.0)
    assert "independent matching windows: 0" in str(data["matcher"].item())
    assert np.isnan(data["matcher_factor"])


def test_a_missing_matcher_is_refused_before_anything_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The message names the package and how to install it."""
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(StudyError, match=r"needs OpenCV.*pip install"):
        study(tmp_path, LOOP.replace("400", "100")).run()


def test_a_plane_nearer_than_the_focal_length_has_no_picture_and_the_others_are_measured(tmp_path: Path) -> None:
    """A main lens of 12.5 mm makes no real image of a plane at 10 mm."""
    text = scene_study(
        PLENOPTIC.format(pixels="[200, 200]", estimator="same-type-pair", lenses=""),
        "{shape: plane, distance: 150 mm}",
        distances="from: 120 mm, to: 200 mm, points: 3",
        window="7 px",
        light="at_f_number: 8",
    )
    loop = "depth_loop: {distances: [10 mm, 150 mm], fitted_at: [150 mm], windows: 100}\n"
    path = tmp_path / "near.yaml"
    path.write_text(text[: text.index("  image:")] + loop, encoding="utf-8")
    study = api.load(path).with_values({"plenoptic.depth.disparity_error": "derived"})
    data = study.run().data["depth_loop"].to_dataset().sel(camera="plenoptic").squeeze()
    assert "near" in str(data["reason"].sel(distance=0.01).item())
    assert data["depth_measured"].values.tolist()[0] == 0.0
    assert data["depth_measured"].values.tolist()[1] > 0.0
