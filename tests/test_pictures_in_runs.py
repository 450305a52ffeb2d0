"""What a run keeps and shows of the pictures of its scene, against the files that it writes beside the report."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from tests.test_render import STEP, study
from tradestudy import api, figures
from tradestudy.errors import PlaceError
from tradestudy.report.contents import compose_report
from tradestudy.report.document import Table
from tradestudy.results import storage

pytestmark = pytest.mark.usefixtures("only_rays")


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[api.Result, Path]:
    folder = tmp_path_factory.mktemp("ran")
    return api.run(study(folder, STEP), folder / "out", pdf=False), folder / "out"


def test_a_run_writes_the_pictures_that_render_writes(ran: tuple[api.Result, Path], tmp_path: Path) -> None:
    _, out = ran
    api.render(study(tmp_path, STEP), tmp_path)
    own = {path.relative_to(tmp_path / "pictures") for path in (tmp_path / "pictures").glob("*/*.*")}
    assert own == {path.relative_to(out / "pictures") for path in (out / "pictures").glob("*/*.*")}
    for path in own:
        assert (out / "pictures" / path).read_bytes() == (tmp_path / "pictures" / path).read_bytes()


def test_a_later_report_of_a_run_with_pictures_is_identical(ran: tuple[api.Result, Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(ran[1], out)
    written = (out / "report.html").read_bytes()
    api.report(out, pdf=False)
    assert (out / "report.html").read_bytes() == written


def test_pictures_of_an_earlier_run_stay_until_the_next_is_complete(
    ran: tuple[api.Result, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def content() -> dict[Path, bytes]:
        return {
            path: path.read_bytes() for path in out.rglob("*") if path.is_file() and ".unfinished" not in path.parts
        }

    out = tmp_path / "out"
    shutil.copytree(ran[1], out)
    (out / "pictures/pair/notes.txt").write_text("mine")
    before = content()

    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("tradestudy.answers.runner._answers", interrupt)  # after the pictures
        with pytest.raises(KeyboardInterrupt):
            api.run(study(tmp_path, STEP), out, pdf=False, fresh=True)
    assert content() == before
    other = study(tmp_path, STEP.replace("170 mm", "160 mm"))
    with monkeypatch.context() as patched:  # the next run ends when its record is complete
        patched.setattr("tradestudy.results.storage._replace_folder", interrupt)
        patched.setattr("tradestudy.api.shutil.rmtree", lambda *_, **__: None)  # a death removes nothing
        with pytest.raises(KeyboardInterrupt):
            api.run(other, out, pdf=False)
    storage.remove_abandoned(out)
    depth = np.asarray(Image.open(out / "pictures/pair/left_depth.tiff"))
    assert float(np.nanmax(depth[np.isfinite(depth)])) == pytest.approx(0.16, rel=1e-6)
    assert (out / "pictures/pair/notes.txt").read_text() == "mine"
    assert not list(out.glob(".*.part"))


def test_pictures_of_others_are_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "pictures/pair").mkdir(parents=True)
    (tmp_path / "pictures/pair/left.png").write_text("mine")
    with pytest.raises(PlaceError, match="did not write"):
        api.render(study(tmp_path, STEP), tmp_path)
    with pytest.raises(PlaceError, match="did not write"):
        api.run(study(tmp_path, STEP), tmp_path, pdf=False)
    assert (tmp_path / "pictures/pair/left.png").read_text() == "mine"


def test_results_keep_blocks_details_and_depth_of_them(ran: tuple[api.Result, Path]) -> None:
    result, out = ran
    data = result.data["pictures"].to_dataset()
    assert data["picture"].values.tolist() == ["pair left", "pair right", "plenoptic raw"]
    for name in data["picture"].values:
        one = data.sel(picture=name)
        camera, picture = str(name).split(" ")
        values = np.asarray(Image.open(out / "pictures" / camera / f"{picture}.png"), dtype=np.float64)
        depth = np.asarray(Image.open(out / "pictures" / camera / f"{picture}_depth.tiff"))
        rows, columns = values.shape
        assert float(one["block"]) == 1.0  # small pictures stay whole
        np.testing.assert_allclose(one["brightness"].values[:rows, :columns], values / values.max(), rtol=1e-12)
        np.testing.assert_array_equal(one["true_depth"].values[:rows, :columns], depth)
        assert np.isnan(one["brightness"].values[rows:]).all()
        side = data.sizes["detail_row"]
        middle = values[(rows - side) // 2 :, (columns - side) // 2 :][:side, :side]
        np.testing.assert_allclose(one["detail"].values, middle / values.max(), rtol=1e-12)
        assert (float(one["rows"]), float(one["columns"])) == (rows, columns)


def test_the_step_of_the_scene_is_in_the_depths(ran: tuple[api.Result, Path]) -> None:
    depth = ran[0].data["pictures"]["true_depth"].sel(picture="pair left").values
    seen = np.unique(np.round(depth[np.isfinite(depth)], 3))
    assert seen.tolist() == [0.13, 0.17]


def test_the_report_shows_every_camera_and_lists_every_picture(ran: tuple[api.Result, Path]) -> None:
    tree = ran[0].data
    drawings = figures.build(tree)
    assert "Pair and Plenoptic" in drawings["scene_pictures"].alt
    assert drawings["scene_pictures"].draw().svg()
    report = compose_report(tree, ran[0].run_record, drawings)
    (table,) = (block for block in report.blocks if isinstance(block, Table) and block.name == "scene-pictures-table")
    assert [row[1] for row in table.rows] == ["left", "right", "raw"]
    assert table.rows[0][2] == "160 × 100"


def test_large_pictures_are_reduced_by_whole_blocks() -> None:
    from types import SimpleNamespace

    from tradestudy.answers.scene import _block, _reduced

    values = np.arange(600.0 * 500.0).reshape(600, 500)
    one = SimpleNamespace(values=values, depth=np.ones((600, 500), dtype=np.float32))
    assert _block(one) == 3  # type: ignore[arg-type]  # a stand-in
    brightness, depth = _reduced(one)  # type: ignore[arg-type]  # a stand-in
    assert brightness.shape == depth.shape == (200, 166)
    assert brightness[1, 2] == pytest.approx(values[3:6, 6:9].mean() / values.max())
