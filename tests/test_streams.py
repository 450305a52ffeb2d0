"""What reaches terminals, pipes and pages: nothing of a study acts there, and no closed stream ends a command."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from tradestudy import api, cli
from tradestudy.errors import OutOfRangeError, Problem, StudyError, escaped
from tradestudy.report import csv_tables
from tradestudy.wording import json_text

RIGHT = Path(__file__).parent / "study" / "wrong" / "right.yaml"
# A study that is computed and reported quickly.
QUICK = "format: 2\nstudy: quick\ntitle: T\nquestion: Q\nhard_cases: {families: [equation-27]}\n"
# Sets a terminal's title, colours, C1 controls, directions of writing, line ends; a new line that looks like an answer.
HOSTILE = "\x1b]0;mine\x07 \x1b[2J \x9b31m \x7f \u202eleft\u2066 \u200f \u061c \u2028 end\nMet: all requirements"
ACTS = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def _hostile_study(folder: Path) -> Path:
    said = json.dumps(HOSTILE)  # a JSON text is a YAML text
    text = RIGHT.read_text(encoding="utf-8").replace("title: A study with a mistake", f"title: {said}")
    text = text.replace(
        "rig: {from: cameras/rig.yaml}", f"rig: {{from: {RIGHT.parent}/cameras/rig.yaml, title: {said}}}"
    )
    text = text.replace("  array: {from: cameras/plenoptic.yaml}\n", "").replace("note: close range", f"note: {said}")
    wanted = "camera: any, depth_uncertainty: {below: 1 um, over: [0.1 m, 1 m]}"
    text += f"requirements:\n  close: {{says: {said}, {wanted}}}\n"
    path = folder / "hostile.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def _process(*words: str | Path, shell: str = "", **environment: str) -> subprocess.CompletedProcess[bytes]:
    """Run a command; ``shell`` closes or redirects its streams."""
    command = ["bash", "-c", f'"$@" {shell}', "bash", sys.executable, "-m", "tradestudy", *map(os.fsencode, words)]
    return subprocess.run(command, capture_output=True, check=False, env={**os.environ, **environment})


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("50 µm – Rig\N{NO-BREAK SPACE}α 日", "50 µm – Rig\N{NO-BREAK SPACE}α 日"),
        ("\x1b[31m\x9b\x7f\t", r"\x1b[31m\x9b\x7f\t"),
        ("a\nMet: b\r", r"a\nMet: b\r"),
        ("\u202e\u2066\u061c\u200f\u2028", r"\u202e\u2066\u061c\u200f\u2028"),
        (os.fsdecode(b"n\xff.yaml"), r"n\xff.yaml"),
        ("\ud800\ufffe", r"\ud800\ufffe"),
    ],
)
def test_what_acts_on_a_terminal_is_escaped(text: str, shown: str) -> None:
    assert escaped(text) == shown
    assert escaped(shown) == shown


def test_errors_escape_what_they_quote() -> None:
    error = OutOfRangeError("first\nsecond", value=HOSTILE, remedy=HOSTILE)
    assert str(error).count("\n") == 1
    assert not ACTS.search(str(error))
    assert str(Problem(file="a\nb", line=1, column=2, path="x", what="\x1b")) == r"a\nb:1:2: x: \x1b"


def test_json_is_ascii_and_the_same_value() -> None:
    assert json_text({"title": HOSTILE}).isascii()
    assert not ACTS.search(json_text({"title": HOSTILE}))
    assert json.loads(json_text({"title": HOSTILE})) == {"title": HOSTILE}


def test_tables_keep_lines_and_nothing_that_acts() -> None:
    group = xr.Dataset({"name": ("row", np.array([HOSTILE], dtype=object))})
    (pieces,) = csv_tables.tables(xr.DataTree.from_dict({"/g": group.assign_coords(row=[0])})).values()
    table = b"".join(pieces).decode()
    assert "\nMet" in table
    assert not ACTS.search(table)


@pytest.mark.usefixtures("empty_figures")
def test_texts_of_a_study_act_nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    study = _hostile_study(tmp_path)
    run = CliRunner().invoke(cli.app, ["run", str(study), "--out", "out", "--strict", "--no-pdf"])
    assert run.exit_code == 3, run.output
    assert run.output.count("\nNot met: ") == 1
    other = api.load(study, ["rig.baseline=90 mm"]).run()
    compared = CliRunner().invoke(cli.app, ["compare", "out", str(other.write("other", pdf=False)), "--html", "c.html"])
    assert compared.exit_code == 0, compared.output
    assert "baseline" in compared.output
    for shown in (run.output, compared.output, json_text(other.conclusions())):
        assert not ACTS.search(shown)
        assert not re.search("^ *Met: all", shown, re.MULTILINE)
    pages = [path for path in tmp_path.rglob("*") if path.suffix in (".html", ".csv", ".json", ".svg")]
    assert {path.name for path in pages} >= {"c.html", "report.html", "run.json", "cameras_by_camera.csv"}
    for page in pages:
        assert not ACTS.search(page.read_text(encoding="utf-8")), page


@pytest.mark.parametrize("shell", ["2>/dev/full", "<&- 2>&-"])
def test_streams_that_nobody_reads_do_not_end_a_run(shell: str, tmp_path: Path) -> None:
    (tmp_path / "quick.yaml").write_text(QUICK, encoding="utf-8")
    done = _process("run", tmp_path / "quick.yaml", "--out", tmp_path / "out", "--no-pdf", shell=shell)
    assert done.returncode == 0
    assert b"Report: " in done.stdout
    assert (tmp_path / "out" / "report.html").exists()


@pytest.mark.parametrize("shell", ["2>&-", "2>/dev/full", "2> >(true)", ">&- 2>&-"])
def test_an_error_that_nobody_reads_keeps_its_exit_status(shell: str) -> None:
    assert _process("check", RIGHT.with_name("wrong_dimension.yaml"), shell=shell).returncode == 2


def test_closed_output_is_no_error() -> None:
    done = _process("check", RIGHT, shell=">&-")
    assert (done.returncode, done.stdout, done.stderr) == (0, b"", b"")


def test_a_full_disk_under_the_output_is_told() -> None:
    done = _process("check", RIGHT, shell=">/dev/full")
    assert done.returncode == 1
    assert b"No space left on device" in done.stderr
    assert done.stderr.count(b"\n") == 1


@pytest.mark.parametrize("locale", [{"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0"}])
def test_any_locale_can_show_what_is_printed(locale: dict[str, str], tmp_path: Path) -> None:
    study = tmp_path / "study.yaml"
    study.write_text(RIGHT.read_text(encoding="utf-8").replace("baseline: {value: 20 mm", "baseline: {value: 9 m"))
    study.with_name("cameras").symlink_to(RIGHT.parent / "cameras")
    done = _process("plan", study, **locale)
    assert done.returncode == 0, done.stderr
    assert b"rig" in done.stdout
    assert json.loads(_process("schema", **locale).stdout) == api.schema()


def test_names_that_are_not_utf_8(tmp_path: Path) -> None:
    study, out, page = (tmp_path / os.fsdecode(name) for name in (b"n\xff.yaml", b"out\xff", b"page\xff.html"))
    study.write_text(QUICK, encoding="utf-8")
    done = _process("run", study, "--out", out, "--no-pdf", "--json")
    assert (done.returncode, b"Traceback" in done.stderr) == (0, False), done.stderr
    assert json.loads(done.stdout)["report"] == str(out / "report.html")
    assert json.loads((out / "run.json").read_text(encoding="utf-8"))["file"] == str(study)
    compared = _process("compare", out, out, "--html", page)
    assert compared.returncode == 0, compared.stderr
    assert rb"Page: " in compared.stdout
    assert rb"page\xff.html" in compared.stdout
    assert page.exists()
    missing = _process("check", study.with_name(os.fsdecode(b"none\xff.yaml")))
    assert missing.returncode == 2
    assert rb"none\xff.yaml" in missing.stderr


def test_python_errors_name_paths_and_commands_name_options() -> None:
    study = api.load(RIGHT)
    for change in (
        lambda: study.with_values({"rig.baseline": "20"}),
        lambda: api.load(RIGHT, ["rig.baseline=20"]),
        lambda: api.load(RIGHT, tolerance="20 furlongs"),
    ):
        with pytest.raises(StudyError) as caught:
            change()
        assert "--" not in str(caught.value)
        assert re.match(r"(cameras\.rig\.baseline|accuracy\.tolerance): ", str(caught.value))
    assert CliRunner().invoke(cli.app, ["check", str(RIGHT), "--set", "rig.baseline=20"]).stderr.startswith("--set:1:")


@pytest.mark.usefixtures("empty_figures")
def test_results_are_compared_as_folders_files_and_objects(tmp_path: Path) -> None:
    result = api.load(RIGHT).run()
    out = result.write(tmp_path / "out", pdf=False)
    assert "identical" in str(api.compare([out, out / "results.nc"]))
    assert "baseline" in str(api.compare([result, api.load(RIGHT, ["rig.baseline=90 mm"]).run()]))
    kept = {path: path.read_bytes() for path in out.iterdir() if path.is_file()}
    for target in ("run.json", "results.nc", "report.html"):
        refused = CliRunner().invoke(cli.app, ["compare", str(out), str(out), "--html", str(out / target)])
        assert refused.exit_code == 2
        assert "name another file" in refused.stderr
    assert {path: path.read_bytes() for path in out.iterdir() if path.is_file()} == kept
    page = ["compare", str(out), str(out), "--html", str(tmp_path / "c.html")]
    assert [CliRunner().invoke(cli.app, page).exit_code for _ in range(2)] == [0, 0]
    record = json.loads((out / "run.json").read_text(encoding="utf-8"))
    for key in record:
        (out / "run.json").write_text(json.dumps({**record, key: [{}]}), encoding="utf-8")
        refused = CliRunner().invoke(cli.app, ["report", str(out), "--no-pdf"])
        assert refused.exit_code == 1, key
        assert f"'{key}'" in refused.stderr
    (out / "run.json").write_text("[" * 100_000, encoding="utf-8")
    refused = CliRunner().invoke(cli.app, ["report", str(out)])
    assert (refused.exit_code, refused.stderr.count("\n")) == (1, 1)
