"""The command line from a study file to a report, as a newcomer runs it, in a folder of its own."""

from __future__ import annotations

import json
import re
import shutil
import signal
import subprocess
import sys
import time
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pypdfium2
import pytest
from typer.testing import CliRunner

from tests.conftest import HeadlineRun
from tradestudy import load
from tradestudy.cli import app

STUDIES = Path(__file__).parent.parent / "studies"
HEADLINE = STUDIES / "plenoptic_vs_stereo.yaml"
SMALL = """
format: 2
study: small
title: A stereo rig
question: What happens to any run?
cameras:
  rig:
    kind: stereo
    title: Rig
    sensor: {pixels: [1280, 800], pixel_pitch: 3 um}
    lenses: {focal_length: 2 mm, f_number: 2}
    baseline: 50 mm
    convergence_distance: inf
    focus_distance: 1 m
    depth: {estimator: disparity, disparity_error: 0.1 px, discrimination_step: 0.1 px}
    calibration: {errors: {yaw: {standard_deviation: 0.01 deg}}}
scene: {distances: [0.5 m, 1 m, 2 m], wavelength: 550 nm}
"""


def tradestudy(*arguments: str | Path, cwd: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "tradestudy", *map(str, arguments)],
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )


@pytest.fixture(scope="module")
def run_folder(headline_run: HeadlineRun) -> Path:
    return headline_run.folder


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("small") / "small.yaml"
    path.write_text(SMALL, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def small_run(small: Path) -> Path:
    folder = small.parent / "run"
    done = CliRunner().invoke(app, ["run", str(small), "--out", str(folder), "--quiet"])
    assert (done.exit_code, done.output) == (0, "")
    return folder


class Page(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.ids: list[str] = []
        self.headings: list[str] = []
        self.pictures: list[dict[str, str | None]] = []
        self.outside: list[str] = []
        self.text: list[str] = []
        self._heading = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        if "id" in found:
            self.ids.append(found["id"] or "")
        if tag in ("img", "svg"):
            self.pictures.append(found)
        for key in ("src", "href"):
            target = found.get(key) or ""
            if target.startswith(("http", "//", "file")):
                self.outside.append(target)
        if tag in ("h1", "h2", "h3"):
            self.headings.append("")
            self._heading = True

    def handle_endtag(self, tag: str) -> None:
        if tag in ("h1", "h2", "h3"):
            self._heading = False

    def handle_data(self, data: str) -> None:
        self.text.append(data)
        if self._heading:
            self.headings[-1] += data


def test_a_run_prints_its_conclusions_and_fails_if_strict_and_missed(headline_run: HeadlineRun) -> None:
    done = headline_run.done
    assert done.returncode == 3, done.stderr
    *reported, last = done.stdout.splitlines()
    assert last == "Report: reports/plenoptic-vs-stereo/report.html"
    assert reported[0].startswith("From ")
    assert not any(one.startswith("Best") for one in reported), "the first line says it"
    assert len(reported) <= 6
    assert "close-range" in done.stderr.splitlines()[-1]


def test_everything_a_run_writes_is_there(run_folder: Path) -> None:
    for name in ("report.html", "report.pdf", "results.nc", "run.json"):
        assert (run_folder / name).stat().st_size > 500
    assert {"whole_range.svg", "close_range.svg", "mid_range.svg"} <= {
        p.name for p in (run_folder / "figures").iterdir()
    }
    assert len(list((run_folder / "tables").glob("*.csv"))) >= 5
    assert not [path for path in run_folder.rglob("*") if path.name.endswith(".part")]
    record = json.loads((run_folder / "run.json").read_text())
    assert {"study_hash", "code_hash", "versions", "machine", "seconds", "seed"} <= record.keys()


def test_html_is_whole_self_contained_and_accessible(run_folder: Path) -> None:
    page = Page()
    page.feed((run_folder / "report.html").read_text(encoding="utf-8"))
    assert not page.outside
    assert [name for name, count in Counter(page.ids).items() if count > 1] == []
    assert len(page.pictures) >= 5
    for picture in page.pictures:
        assert picture.get("alt") or picture.get("aria-label") or picture.get("aria-hidden"), picture
    headings = " | ".join(page.headings)
    for word in ("answer", "Assumptions", "Method", "Results", "Claims", "Contradictions", "Provenance"):
        assert word.lower() in headings.lower()
    text = " ".join(page.text)
    for claim in ("C1", "C2", "C3", "C4", "C5", "cannot be decided from its source", "0.582°", "48.51°", "19.06°"):
        assert claim in text


def test_pdf_pages_carry_headings_and_plotted_curves(run_folder: Path) -> None:
    document = pypdfium2.PdfDocument(run_folder / "report.pdf")
    texts = [page.get_textpage().get_text_range() for page in document]
    whole = "\n".join(texts)
    for heading in ("The answer", "Assumptions", "Method", "Results", "Claims", "Contradictions found", "Provenance"):
        assert heading in whole
    assert "Raytrix R5 against a stereo rig" in texts[0]
    coloured = []
    for page in document:
        pixels = page.render(scale=1.5).to_numpy().astype(int)
        spread = pixels.max(axis=2) - pixels.min(axis=2)
        coloured.append(np.count_nonzero(spread > 60))
    # The first page's figure holds the curves of six cameras, and at least three more pages hold figures of results.
    assert coloured[0] > 2000
    assert sum(count > 2000 for count in coloured) >= 4
    # A curve runs across the page: coloured pixels in most columns of the plot.
    first = document[0].render(scale=1.5).to_numpy().astype(int)
    columns = ((first.max(axis=2) - first.min(axis=2)) > 60).any(axis=0)
    assert columns[columns.argmax() :].sum() > 400


def test_the_main_part_of_the_pdf_is_short_and_full(run_folder: Path) -> None:
    document = pypdfium2.PdfDocument(run_folder / "report.pdf")
    (first,) = [mark.get_dest().get_index() for mark in document.get_toc() if mark.get_title() == "Appendices"]
    assert first <= 3  # pages before the one on which they begin
    for number in range(first):
        pixels = document[number].render(scale=1.0).to_numpy().min(axis=2)
        rows = np.flatnonzero((pixels < 250).any(axis=1))
        last = rows[rows < 0.94 * len(pixels)].max()  # above the number of the page
        assert last > 0.6 * len(pixels), f"page {number + 1} is not full"


def test_the_first_page_of_a_camera_choice_is_silent_on_laws_of_diffraction(run_folder: Path) -> None:
    """Estimator, relay, yaw and z − f_M decide here; Kirchhoff against Fresnel does not, and must not seem to."""
    html = (run_folder / "report.html").read_text(encoding="utf-8")
    body = html[html.index('id="answer"') :]
    answer = Page()
    answer.feed(body[: body.index('id="cameras"')])
    first = pypdfium2.PdfDocument(run_folder / "report.pdf")[0].get_textpage().get_text_range()
    for text in (" ".join(answer.text), first):
        says = " ".join(text.split()).replace(" :", ":")  # HTML ends the bold words before the colon
        assert "Rests on (measure first): yaw of the 8 mm stereo rig" in says
        assert "yaw" in text
        assert not re.search("kirchhoff|fresnel|boundary wave|diffraction", text, re.IGNORECASE)


def test_report_again_gives_identical_bytes(run_folder: Path) -> None:
    """From another process, and with figures drawn by one interpreter instead of two."""
    kept = {path: path.read_bytes() for path in sorted(run_folder.rglob("*")) if path.is_file()}
    assert CliRunner().invoke(app, ["report", str(run_folder)]).exit_code == 0
    assert {path: path.read_bytes() for path in sorted(run_folder.rglob("*")) if path.is_file()} == kept


def test_finished_results_are_not_computed_again_unless_asked(small: Path, small_run: Path, tmp_path: Path) -> None:
    def run(*more: str) -> None:
        assert CliRunner().invoke(app, ["run", str(small), "--out", str(folder), *more]).exit_code == 0

    def started() -> str:
        return str(json.loads((folder / "run.json").read_text())["started"])

    folder = tmp_path / "copy"
    shutil.copytree(small_run, folder)
    first = started()
    (folder / "report.pdf").unlink()
    run()
    assert started() == first
    assert (folder / "report.pdf").read_bytes() == (small_run / "report.pdf").read_bytes()
    record = json.loads((folder / "run.json").read_text())
    (folder / "run.json").write_text(json.dumps({**record, "started": "2000-01-01T00:00:00+00:00"}))
    run("--fresh", "--no-pdf")
    assert started() >= first


def test_a_wrong_study_writes_nothing(run_folder: Path, tmp_path: Path) -> None:
    folder = tmp_path / "reports"
    shutil.copytree(run_folder, folder)
    kept = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    done = tradestudy("run", HEADLINE, "--set", "stereo-short.baseline=20", "--out", folder, cwd=tmp_path)
    assert done.returncode == 2
    assert re.search(r"--set:1:\d+: cameras\.stereo-short\.baseline: '20' has no unit", done.stderr)
    assert "Traceback" not in done.stderr
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == kept


@pytest.mark.slow
def test_a_killed_run_leaves_no_partial_file_and_can_be_finished(small: Path, small_run: Path, tmp_path: Path) -> None:
    """Each run finds what the one before it left; the last one differs from an undisturbed one in its provenance."""
    folder = tmp_path / "killed"
    for delay in (0.6, 1.2, 1.8):
        process = subprocess.Popen(
            [sys.executable, "-m", "tradestudy", "run", str(small), "--out", str(folder), "--quiet"], cwd=tmp_path
        )
        time.sleep(delay)
        process.send_signal(signal.SIGKILL)
        process.wait()
        if (folder / "report.html").exists():
            assert (folder / "report.html").read_text(encoding="utf-8").rstrip().endswith("</html>")
        if (folder / "report.pdf").exists():
            pypdfium2.PdfDocument(folder / "report.pdf")
    again = CliRunner().invoke(app, ["run", str(small), "--out", str(folder), "--quiet"])
    assert (again.exit_code, again.output) == (0, "")
    names = {path.relative_to(folder) for path in folder.rglob("*") if path.is_file()}
    assert names == {path.relative_to(small_run) for path in small_run.rglob("*") if path.is_file()}
    for name in names - set(map(Path, ("run.json", "report.html", "report.pdf"))):
        assert (folder / name).read_bytes() == (small_run / name).read_bytes(), name

    def without_provenance(folder: Path) -> str:
        html = (folder / "report.html").read_text(encoding="utf-8")
        return html[: html.index('id="provenance"')]

    assert without_provenance(folder) == without_provenance(small_run)


def test_a_study_whose_data_file_changed_is_another_study(tmp_path: Path) -> None:
    """So that a finished run is not taken for the answer to another calibration."""
    covariance = tmp_path / "covariance.csv"
    covariance.write_text("parameter,mean,yaw\nyaw,0.0,3e-8\n", encoding="utf-8")
    study = tmp_path / "small.yaml"
    errors = "{errors: {yaw: {standard_deviation: 0.01 deg}}}"
    assert errors in SMALL
    study.write_text(SMALL.replace(errors, "{posterior: {file: covariance.csv}}"), encoding="utf-8")
    loaded = load(study)
    assert list(loaded.definition.data_files.values()) == [covariance]
    before = loaded.hash
    covariance.write_text("parameter,mean,yaw\nyaw,0.0,4e-8\n", encoding="utf-8")
    assert loaded.hash != before
