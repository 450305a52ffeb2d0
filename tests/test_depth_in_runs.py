"""What a run keeps and shows of depth that is measured in the pictures of its scene, against its files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.test_depth_maps import study_text
from tradestudy import api, figures
from tradestudy.cameras.depth_map import DepthMap, TrueDepth
from tradestudy.execution import Threads
from tradestudy.imaging.estimation import DepthScore, score
from tradestudy.optics.window_matching import Reason
from tradestudy.report.contents import compose_report
from tradestudy.report.document import Appendices, Paragraph, Table, plain_text

pytestmark = pytest.mark.usefixtures("only_rays")

ROCK = "{shape: rock, near: 140 mm, far: 160 mm, feature_size: 10 mm}"


def study(folder: Path) -> api.Study:
    path = folder / "maps.yaml"
    text = study_text("plenoptic", ROCK, length="0.5 mm", pixels="[260, 260]", more="depth_maps: true")
    path.write_text(text, encoding="utf-8")
    return api.load(path)


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[api.Result, Path]:
    folder = tmp_path_factory.mktemp("ran")
    return api.run(study(folder), folder / "out", pdf=False), folder / "out"


def test_results_contain_the_scores_and_maps_of_the_files(ran: tuple[api.Result, Path]) -> None:
    result, out = ran
    data = result.data["pictures"].to_dataset()
    assert data["mapped_camera"].values.tolist() == ["plenoptic"]
    folder, one = out / "pictures" / "plenoptic", data.sel(mapped_camera="plenoptic")
    reported = json.loads((folder / "depth_map.json").read_text(encoding="utf-8"))["score"]
    for key in ("bias", "spread", "filled", "over_bound"):
        assert float(one[f"depth_{key}"]) == reported[key]
        assert float(one[f"depth_{key}_error"]) == reported["standard_errors"][key]
    depth, true = (np.load(folder / f"depth_map{suffix}.npy") for suffix in ("", "_true"))
    block = int(one["map_block"])
    rows, columns = (size // block for size in depth.shape)
    row, column = np.argwhere(np.isfinite(one["map_depth"].values))[5]
    assert row < rows
    assert column < columns
    place = np.s_[row * block : (row + 1) * block, column * block : (column + 1) * block]
    assert float(one["map_depth"][row, column]) == pytest.approx(np.nanmedian(depth[place]), rel=1e-6)
    assert np.isfinite(one["class_spread"].values).all()
    middle = one["class_distance"].values
    assert np.all(np.diff(middle) > 0.0)
    assert np.nanmin(true) <= middle[0] <= middle[-1] <= np.nanmax(true)


def test_the_camera_measures_the_rock_as_predicted(ran: tuple[api.Result, Path]) -> None:
    one = ran[0].data["pictures"].to_dataset().sel(mapped_camera="plenoptic")
    assert float(one["depth_filled"]) >= 0.7
    assert float(one["depth_within"]) >= 0.9
    assert float(one["depth_over_bound"]) > 1.0 - 2.0 * float(one["depth_over_bound_error"])
    # Windows of nine pixels share all but one column with those beside, and nothing with those one window apart.
    assert float(one["depth_neighbour_correlation"]) > 0.6
    assert abs(float(one["depth_window_correlation"])) < 0.25


def test_the_report_shows_maps_and_compares_them(ran: tuple[api.Result, Path]) -> None:
    tree = ran[0].data
    drawings = figures.build(tree)
    assert drawings["depth_maps"].draw().svg()
    assert drawings["depth_achieved"].draw().svg()
    report = compose_report(tree, ran[0].run_record, drawings)
    tables = {block.name: block for block in report.blocks if isinstance(block, Table)}
    appendices = report.blocks.index(Appendices())
    early = {"depth-maps-depth-table"}
    late = {"depth-maps-disparity-table", "scene-pictures-table"}
    assert early == {name for name in early | late if report.blocks.index(tables[name]) < appendices}
    assert [row[0] for row in tables["depth-maps-depth-table"].rows] == ["Plenoptic"]
    assert plain_text(tables["depth-maps-disparity-table"].rows[0][1]) != "—"
    reported = [plain_text(block.text) for block in report.blocks if isinstance(block, Paragraph)]
    (matcher,) = (text for text in reported if "matcher: {" in text)
    assert matcher.startswith("Plenoptic: matcher: {factor: ")
    assert matcher.endswith(" windows).")
    spread = float(tree["pictures"]["depth_spread"][0])
    shown, error = (float(one) for one in plain_text(tables["depth-maps-depth-table"].rows[0][2]).split()[0:3:2])
    assert abs(shown - spread * 1e6) <= error < 0.1 * shown  # "700 ± 20 µm"


def test_maps_do_not_depend_on_the_executor(ran: tuple[api.Result, Path], tmp_path: Path) -> None:
    api.render(study(tmp_path), tmp_path, depth=True, executor=Threads(2))
    for path in (tmp_path / "pictures").glob("*/depth_map*"):
        assert path.read_bytes() == (ran[1] / "pictures" / path.parent.name / path.name).read_bytes()


def test_standard_errors_are_those_of_repetitions() -> None:
    """Maps whose errors are drawn, one for each window of three pixels: the jackknife against many such maps."""
    rng = np.random.default_rng(3)
    shape = (120, 120)
    true = np.full(shape, 0.5)

    def one() -> DepthScore:
        error = np.kron(rng.standard_normal((40, 40)), np.ones((3, 3))) * 0.02
        return score(
            DepthMap(
                depth=true + error,
                deviation=np.full(shape, 0.01),
                disparity_deviation=np.full(shape, 0.1),
                reason=np.full(shape, Reason.MEASURED, np.uint8),
            ),
            TrueDepth(depth=true, measurable=np.ones(shape, bool)),
            np.full(shape, 0.02),
            3.0,
        )

    scores = [one() for _ in range(30)]
    for name, expected in (("bias", 0.0), ("spread", 0.02), ("over_bound", 2.0), ("spread_px", 0.2)):
        values = np.array([getattr(each, name) for each in scores])
        reported = np.sqrt(np.mean([each.standard_errors[name] ** 2 for each in scores]))
        assert np.mean(values) == pytest.approx(expected, abs=4.0 * np.std(values) / np.sqrt(30))
        assert reported == pytest.approx(np.std(values), rel=0.4)
    assert np.mean([each.neighbour_correlation for each in scores]) == pytest.approx(2.0 / 3.0, abs=0.02)
    assert np.mean([each.window_correlation for each in scores]) == pytest.approx(0.0, abs=0.02)
    assert scores[0].windows == 1600.0


def test_figures_of_a_camera_that_measured_nothing_say_so_and_a_bias_fits_its_scale(
    ran: tuple[api.Result, Path],
) -> None:
    tree = ran[0].data.copy(deep=True)
    pictures = tree["pictures"]
    pictures["depth_bias"][:] = 0.02
    pictures["depth_spread"][:] = 0.001
    assert "error, ±23 mm" in figures.build(tree)["depth_maps"].draw().svg().decode()
    pictures["class_bias"][:] = np.nan
    drawn = figures.build(tree)["depth_achieved"].draw().svg().decode()
    assert "measured nothing" in drawn
    assert "Plenoptic" in drawn


def test_a_range_shorter_than_a_factor_of_two_has_its_labels_in_the_figure(ran: tuple[api.Result, Path]) -> None:
    curves, bars = figures.figure(ran[0].data, "whole_range").axes[:2]
    assert "pair" in [text.get_text() for text in bars.texts]
    assert any(text.get_text().endswith("%") or "% of" in text.get_text() for text in curves.texts)
