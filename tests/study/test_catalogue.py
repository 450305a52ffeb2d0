"""The catalogue of cameras: its entries are complete, its index is theirs, and studies start from them."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
import time
from functools import cache
from pathlib import Path

import pytest
from pydantic import ValidationError
from typer.testing import CliRunner, Result

import tradestudy
from tests.catalogue_index import text as text_of_index
from tradestudy import cli
from tradestudy.cameras.stated_declaration import StatedAccuracyPart
from tradestudy.catalogue import INDEX, PREFIX, entry_names, entry_path, listed, revision, wanted
from tradestudy.errors import StudyError
from tradestudy.study.catalogue_entries import Entry, entry_of, incomplete
from tradestudy.study.document import Source

ENTRY = entry_path("oak-d").read_text(encoding="utf-8")


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@cache
def entry(name: str) -> Entry:
    return entry_of(PREFIX + name)


def invoke(*words: str) -> Result:
    return CliRunner().invoke(cli.app, list(words))


@pytest.mark.parametrize("name", entry_names())
def test_every_value_of_an_entry_has_its_basis_and_source(name: str) -> None:
    assert [str(one) for one in incomplete(entry(name))] == []


@pytest.mark.parametrize("name", entry_names())
def test_size_and_focal_length_or_view_and_baseline_of_an_entry_are_sourced(name: str) -> None:
    annotations = entry(name).definition.document.annotations
    first = {path[2:]: one for path, one in annotations.items() if path[1] == "m0"}
    lens = [one for path, one in first.items() if path[-1] in ("focal_length", "field_of_view") and "lens" in path[0]]
    needed = [first[("sensor", "pixels")], *lens, *([first[("baseline",)]] if ("baseline",) in first else [])]
    assert len(needed) >= 2
    assert all(one.source is not None for one in needed)


def test_one_address_has_one_title_and_every_day_is_past() -> None:
    titles: dict[str, set[str]] = {}
    for name in entry_names():
        for one in entry(name).definition.document.annotations.values():
            if isinstance(one.source, Source) and "compote" not in one.source.url and "MYNT" not in one.source.url:
                titles.setdefault(one.source.url, set()).add(one.source.title)
                assert one.source.read_on <= "2026-11-29"
    assert [url for url, known in titles.items() if len(known) > 1] == []


def test_the_index_is_that_of_the_entries() -> None:
    assert INDEX.read_text(encoding="utf-8") == text_of_index()


def test_nearest_distance_and_view_of_the_index_follow_from_the_numbers_of_the_entry() -> None:
    """By the pinhole and by f B/d from the texts of the files, which the index does not use."""
    rows = {(one.entry, one.mode): one for one in listed()}
    oak = rows["oak-d", "800p"]
    assert oak.nearest == pytest.approx(882.5 * 0.075 / 95, rel=1e-5)
    assert oak.field_of_view == pytest.approx(2 * math.atan(640 / 882.5), rel=1e-5)
    d455 = rows["realsense-d455", "848x480"]
    focal = 424 / math.tan(math.radians(87) / 2)
    assert d455.nearest == pytest.approx(focal * 0.095 / 126, rel=1e-5)
    assert d455.one_pixel == pytest.approx(focal * 0.095, rel=1e-5)
    assert rows["mahli", "close"].baseline is None


def test_contradictions_between_statements_of_makers_are_listed() -> None:
    found = {(mode, one.what.split(" against")[0]) for mode, one in entry("realsense-d435").contradictions()}
    assert found == {("1280x720", "nearest distance")}  # 280 mm is stated, 645 px · 50 mm / 126 px is 256 mm
    assert entry("realsense-d455").contradictions() == []
    assert {one.what.split(" against")[0] for _, one in entry("oak-d").contradictions()} == {"field of view"}


def test_a_claim_that_gave_the_disparity_error_checks_nothing() -> None:
    (mynt,) = entry("mynt-eye-s1030").claims()
    assert "checks nothing" in mynt.verdict
    # 4 % of 5 m is 0.2 m; f is 2.1 mm of 6 um, so that f B is 42 px m.
    assert mynt.implied_px == pytest.approx(0.2 * 42 / 25, rel=1e-9)
    claims = {one.mode: one for one in entry("realsense-d455").claims()}
    assert claims["848x480"].implied_px == pytest.approx(
        0.02 * 424 / math.tan(math.radians(43.5)) * 0.095 / 4, rel=1e-9
    )
    assert "within the claim" in claims["848x480"].verdict


CLAIM = {"says": "x", "metric": "error", "relative": "2 %", "up_to": "4 m", "mode": "x", "target": "x"}


@pytest.mark.parametrize(("share", "sigmas"), [("68.2689492137 %", 1.0), ("0.9999999999999999", 8.2920)])
def test_the_share_of_a_claim_may_be_nearly_all(share: str, sigmas: float) -> None:
    """The half-width of the interval that contains the share 1 − 2⁻⁵³ of a normal error is 8.2920 σ."""
    part = StatedAccuracyPart.model_validate({**CLAIM, "share": share})
    assert part.standard_deviation == pytest.approx(0.08 / sigmas, rel=1e-3)


def test_the_share_of_a_claim_is_not_nearly_none() -> None:
    with pytest.raises(ValidationError, match="says nothing about the error"):
        StatedAccuracyPart.model_validate({**CLAIM, "share": "1e-17"})


def test_derived_disparity_error_must_follow_from_its_claim(tmp_path: Path) -> None:
    text = entry_path("mynt-eye-s1030").read_text(encoding="utf-8").replace("0.336 px", "0.2 px")
    (tmp_path / "mine.yaml").write_text(text, encoding="utf-8")
    (problem,) = incomplete(entry_of("mine.yaml"))
    assert "0.336 px" in problem.what


@pytest.mark.parametrize(
    ("before", "after", "says"),
    [
        ('note: "half of 882', 'nota: "half of 882', "unknown key beside a value"),
        (r" +read_on: .*\n", "", "no read_on"),
        (r"read_on: 2026-11-29", "read_on: 2026-13-29", "a day such as"),
        (r" +basis: datasheet\n", "", "no basis"),
        (r", note: \"rectified pictures\"", "", "needs a note"),
        (r" +source:\n( +(title|revision|url|read_on|quote): .*\n)+", "", "needs its source"),
        (r"  projector:\n(    .*\n)+", "", "stated.projector: this key is missing"),
    ],
)
def test_check_says_what_an_entry_lacks(tmp_path: Path, before: str, after: str, says: str) -> None:
    changed, count = re.subn(before, after, ENTRY, count=1)
    assert count
    (tmp_path / "mine.yaml").write_text(changed, encoding="utf-8")
    result = invoke("cameras", "--check", "mine.yaml")
    assert result.exit_code == 2
    assert says in result.stderr
    assert "mine.yaml:" in result.stderr


def test_check_shows_modes_contradictions_and_claims() -> None:
    text = invoke("cameras", "--check", "catalogue/realsense-d435").stdout
    assert "280 mm, but 255.9 mm" in text
    assert "means a disparity error of 0.32 px" in text
    assert "complete: 3 modes" in text


def test_list_is_filtered_by_kind_range_baseline_and_view() -> None:
    def entries(*words: str) -> set[str]:
        return {one["entry"] for one in json.loads(invoke("cameras", "--json", *words).stdout)["cameras"]}

    assert entries() == set(entry_names())
    assert entries("--kind", "conventional") == {"mahli"}
    assert entries("--baseline", "200 mm to infinity") == {"mastcam-z", "mer-pancam", "multisense-s21"}
    assert entries("--field-of-view", "0 deg to 10 deg") == {"mastcam-z"}
    near = entries("--range", "60 mm to 5 m")
    assert near == {"realsense-d405"}
    content = json.loads(invoke("cameras", "--json", "--range", "0.5 m to 3 m").stdout)
    assert {one["entry"] for one in content["undecided"]} >= {"zed", "raytrix-r5"}
    assert content["wanted"]


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--range", "5 m to 1 m"), "from small to large"),
        (("--range", "0.6 to 1.5 m"), "both ends with units, such as '0.5 m to 3 m'"),
        (("--baseline", "5"), "such as '0.5 m to 3 m'"),
        (("--field-of-view", "60 to 90"), "such as '60 deg to 90 deg'"),
        (("--kind", "sterio"), "did you mean stereo?"),
        (("--check", "catalogue/oak-d", "--kind", "stereo"), "omit them"),
        (("--check", "realsense-d45"), "catalogue/realsense-d455"),
    ],
)
def test_list_refuses_wrong_filters(words: tuple[str, ...], says: str) -> None:
    result = invoke("cameras", *words)
    assert result.exit_code == 2
    assert says in result.stderr


def test_list_says_that_no_camera_passes() -> None:
    assert invoke("cameras", "--baseline", "1 km to 2 km").stdout.startswith("no camera passes these filters\n")


def test_list_loads_nothing_that_computes_or_reads_studies() -> None:
    code = (
        "import sys, tradestudy.cli as c\nfrom typer.testing import CliRunner\n"
        "assert CliRunner().invoke(c.app, ['cameras']).exit_code == 0\n"
        "assert not {'scipy', 'numpy', 'ruamel.yaml', 'xarray'} & {*sys.modules}, sys.modules.keys()\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_every_wanted_camera_says_what_is_missing() -> None:
    assert all(one.missing and one.found for one in wanted())
    assert not {one.camera for one in wanted()} & {one.title for one in listed()}


STUDY = """
format: 2
study: bins
title: Bin picking
question: Which camera?
cameras:
  a: {from: catalogue/realsense-d455, mode: 848x480}
  b: {from: catalogue/oak-d, depth: {disparity_error: 0.2 px}}
scene: {distances: {from: 0.3 m, to: 2 m, points: 20}, wavelength: 850 nm}
"""


def load(tmp_path: Path, text: str = STUDY) -> tradestudy.Study:
    (tmp_path / "bins.yaml").write_text(text, encoding="utf-8")
    return tradestudy.load(tmp_path / "bins.yaml")


def test_study_uses_an_entry_in_a_mode_and_records_its_revision(tmp_path: Path) -> None:
    result = load(tmp_path).run()
    cameras = result.data["cameras"].to_dataset()
    assert list(cameras["catalogue"].values) == [
        f"realsense-d455, mode 848x480, revision {revision('realsense-d455')}",
        f"oak-d, mode 800p, revision {revision('oak-d')}",
    ]
    assert str(cameras["title"].values[0]) == "RealSense D455 at 848x480"
    notes = dict(zip(*(result.data["assumptions"].to_dataset()[name].values for name in ("path", "note")), strict=True))
    assert "quotes" in str(notes["stated.accuracy.two-percent.relative"]) or "press release" in str(notes)
    assert "https://docs.luxonis.com" in str(notes["baseline"])


@pytest.mark.usefixtures("empty_figures")
def test_compare_names_another_revision_of_an_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    load(tmp_path).run().write(tmp_path / "before", pdf=False)
    monkeypatch.setattr("tradestudy.study.shared_cameras.revision", lambda _: "0123456789ab")
    load(tmp_path).run().write(tmp_path / "after", pdf=False)
    found = str(tradestudy.compare([tmp_path / "before", tmp_path / "after"]))
    assert f"revision {revision('oak-d')}" in found
    assert "revision 0123456789ab" in found


@pytest.mark.parametrize(
    ("before", "after", "says"),
    [
        ("catalogue/oak-d", "catalogue/oak-c", "nearest: 'oak-d'"),
        ("mode: 848x480", "mode: 848", "has no mode '848', but 1280x720, 848x480"),
        ("catalogue/realsense-d455", "catalogue/mer-pancam", "has no modes; remove this key"),
        ("from: catalogue/realsense-d455", "like: b", "to choose one, write from: and the file instead of like:"),
        ("catalogue/oak-d", f"catalogue/{'o' * 5000}", "the catalogue has no 'oooo"),
        ("scene:", "sweep: {a.mode: [848x480, 640x480]}\nscene:", "mode: composes the camera and cannot be set"),
    ],
)
def test_study_with_a_wrong_entry_or_mode_is_refused(tmp_path: Path, before: str, after: str, says: str) -> None:
    with pytest.raises(StudyError, match=re.escape(says)):
        load(tmp_path, STUDY.replace(before, after))


def test_file_with_the_name_of_an_entry_is_not_mistaken_for_it(tmp_path: Path) -> None:
    (tmp_path / "catalogue").mkdir()
    (tmp_path / "catalogue" / "oak-d").write_text(ENTRY, encoding="utf-8")
    with pytest.raises(StudyError, match=re.escape("write ./catalogue/oak-d")):
        load(tmp_path)
    study = load(tmp_path, STUDY.replace("catalogue/oak-d", "./catalogue/oak-d"))
    assert study.prepared.file.cameras["b"].read_as == {}


def test_new_starts_a_study_of_two_cameras_that_answers_for_bin_picking() -> None:
    assert invoke("new", "bins", "--camera", "realsense-d455", "--camera", "oak-d").exit_code == 0
    started = time.process_time()
    result = tradestudy.load("bins.yaml").run()
    assert time.process_time() - started < 60.0
    depth = result.data["depth"].to_dataset()
    near = dict(zip(depth["camera"].values, depth["usable_near"].values, strict=True))
    assert near["oak-d"] == pytest.approx(882.5 * 0.075 / 95, rel=1e-6)
    rows = result.data["requirements"].to_dataset()
    assert list(rows["met"].values) == [1, 1]
    text = " ".join(result.lines())
    assert "2 mm at 0.6 m, by RealSense D455" in text
    assert "beyond the search range of the matcher" in text


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--camera", "oak-d"), "give --camera twice"),
        (("--camera", "realsense-d455", "--camera", "realsense-d455"), "give two that differ"),
        (("--camera", "oak-d", "--camera", "oak-x"), "no such camera"),
        (("--camera", "oak-d", "--camera", "oak-d:500p"), "800p, 800p-extended"),
        (("--camera", "oak-d", "--camera", "mahli"), "measures no depth"),
        (("--camera", "oak-d", "--camera", "zed", "--stereo"), "takes no other cameras"),
    ],
)
def test_new_refuses_what_cannot_be_compared(words: tuple[str, ...], says: str) -> None:
    result = invoke("new", "bins", *words)
    assert result.exit_code == 2
    assert says in result.stderr
    assert not Path("bins.yaml").exists()


def test_new_compares_two_modes_of_a_camera() -> None:
    assert invoke("new", "bins", "--camera", "oak-d:800p", "--camera", "oak-d:400p").exit_code == 0
    assert [*tradestudy.load("bins.yaml").prepared.file.cameras] == ["oak-d-800p", "oak-d-400p"]
