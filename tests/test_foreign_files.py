"""Files that other programs or people wrote are neither replaced nor removed."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.test_cli import RIGHT
from tradestudy.cli import app
from tradestudy.results import storage

pytestmark = pytest.mark.usefixtures("empty_figures")

MINE = b"mine"


def _invoke(*words: object) -> tuple[int, str]:
    ended = CliRunner().invoke(app, [str(word) for word in words])
    return ended.exit_code, " ".join(ended.output.split())


def _content(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished") / "run"
    assert _invoke("run", RIGHT, "--out", folder)[0] == 0
    return folder


@pytest.mark.parametrize(
    "name", ["run.json", "results.nc", "report.html", "report.pdf", "figures/logo.svg", "tables/depths.csv"]
)
def test_a_run_over_files_of_others_is_refused_before_it_computes(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_bytes(MINE)
    monkeypatch.setattr("tradestudy.answers.runner.compute", lambda *_: pytest.fail("computed"))
    code, output = _invoke("run", RIGHT, "--out", tmp_path)
    assert code == 2
    assert f"{tmp_path / name}; move it away, or give another output folder" in output
    assert _content(tmp_path) == {name: MINE}


def test_a_run_keeps_files_of_others_beside_its_own(finished: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(finished, folder)
    added = ("figures/logo.svg", "tables/depths.csv", "notes.txt")
    for name in added:
        (folder / name).write_bytes(MINE)
    assert _invoke("run", RIGHT, "--out", folder, "--fresh", "--no-pdf")[0] == 0
    assert _invoke("report", folder, "--no-pdf")[0] == 0
    after = _content(folder)
    assert after.keys() == _content(finished).keys() - {"report.pdf"} | {*added}  # no PDF of the earlier run
    assert {after[name] for name in added} == {MINE}


@pytest.mark.parametrize("command", [("run", RIGHT, "--out"), ("report",)])
def test_without_a_pdf_that_of_an_earlier_report_is_removed_as_the_help_says(
    command: tuple[object, ...], finished: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    shutil.copytree(finished, folder)
    assert _invoke(*command, folder, "--no-pdf")[0] == 0
    assert _content(folder).keys() == _content(finished).keys() - {"report.pdf"}
    assert "remove that of an earlier report" in _invoke(command[0], "--help")[1]


@pytest.mark.parametrize("fresh", [["--fresh"], []])
def test_a_run_removes_what_only_an_earlier_run_of_other_values_wrote(
    fresh: list[str], finished: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    shutil.copytree(finished, folder)
    assert _invoke("cost", RIGHT, "--budget", "0.3", "--out", folder)[0] == 0
    own, mine = ("posteriors/rig.nc", "matchers.yaml"), ("posteriors/mine.nc", "pictures/rig/notes.txt", "pictures/a")
    for name in (*own, *mine, "pictures/rig/left.png", "pictures/other/left.png"):
        (folder / name).parent.mkdir(exist_ok=True, parents=True)
        (folder / name).write_bytes(MINE)
    storage.list_written(folder, own)
    storage.list_written(folder / "pictures", ["rig/left.png", "other/left.png"])
    assert _invoke("run", RIGHT, "--out", folder, "--no-pdf", *fresh)[0] == 0
    remaining = _content(finished).keys() - {"report.pdf"} | {*mine}
    assert _content(folder).keys() == remaining | {"cost.json", "cost.svg"}  # costs of the same study
    assert not (folder / "pictures/other").exists()
    assert _invoke("run", RIGHT, "--out", folder, "--no-pdf", "--set", "scene.wavelength=500 nm")[0] == 0
    assert _content(folder).keys() == remaining


def test_a_run_of_an_earlier_version_without_a_list_is_replaced(finished: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    shutil.copytree(finished, folder)
    (folder / ".tradestudy").unlink()
    (folder / "figures/logo.svg").write_bytes(MINE)
    assert _invoke("run", RIGHT, "--out", folder, "--fresh", "--no-pdf")[0] == 0
    assert _content(folder).keys() == _content(finished).keys() - {"report.pdf"} | {"figures/logo.svg"}


def test_exports_and_costs_replace_only_their_own(tmp_path: Path) -> None:
    commands = {"rig-opencv.yml": ("export", RIGHT, "rig", "--lossy"), "cost.json": ("cost", RIGHT, "--budget", "0.3")}
    for name, command in commands.items():
        folder = tmp_path / command[0]
        for _ in range(2):
            code, output = _invoke(*command, "--out", folder)
            assert code == 0, output
        assert (folder / name).is_file()
        (folder / ".tradestudy").unlink()
        (folder / name).write_bytes(MINE)
        before = _content(folder)
        code, output = _invoke(*command, "--out", folder)
        assert code == 2
        assert f"{folder}/" in output
        assert "did not write" in output
        assert _content(folder) == before
