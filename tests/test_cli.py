"""The command line: what it prints, where, and how it exits."""

from __future__ import annotations

import importlib.metadata
import io
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import xarray as xr
from typer.testing import CliRunner, Result

import tradestudy
from tradestudy import api, cli, shown_progress
from tradestudy.errors import NotConvergedError, ResultsError, StudyError, UnaffordableError
from tradestudy.results import storage

pytestmark = pytest.mark.usefixtures("empty_figures")

HERE = Path(__file__).parent
RIGHT = HERE / "study" / "wrong" / "right.yaml"
WRONG = HERE / "study" / "wrong" / "wrong_dimension.yaml"
ROBOT = HERE.parent / "studies" / "robot.yaml"


def invoke(*words: object) -> Result:
    return CliRunner().invoke(cli.app, [str(word) for word in words])


def process(*words: object, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tradestudy", *(str(word) for word in words)]
    return subprocess.run(command, capture_output=True, text=True, cwd=folder, timeout=60, check=False)


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


@pytest.fixture
def ran(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """The arguments of a run that computes nothing; put ``unmet`` or ``ends`` in to say how it ends."""
    seen: dict[str, Any] = {"unmet": [], "ends": None}

    def run(study: api.Study, directory: Path, *, progress: Callable[[str, float], None], **options: object) -> object:
        seen.update(study=study, directory=directory, options=options)
        for share in (0.0, 0.5, 1.0):
            progress("depth", share)
        progress("report", 0.0)
        if seen["ends"] is not None:
            raise seen["ends"]
        return SimpleNamespace(unmet_requirements=seen["unmet"], lines=lambda: ("Best: a rig",))

    monkeypatch.setattr(api, "run", run)
    monkeypatch.setattr(api, "tables_left_out", lambda _result: [])
    return seen


class TestCheck:
    def test_says_what_a_study_holds(self) -> None:
        result = invoke("check", RIGHT)
        assert (result.exit_code, result.stderr) == (0, "")
        assert result.stdout.startswith("wrong: 3 cameras, 2 distances")

    def test_tells_all_mistakes_and_nothing_else(self) -> None:
        done = process("check", WRONG.name, folder=WRONG.parent)
        assert (done.returncode, done.stdout) == (2, "")
        with pytest.raises(StudyError) as mistakes:
            api.load(WRONG)
        said = [str(replace(one, file=WRONG.name)) for one in mistakes.value.problems]
        assert done.stderr.splitlines() == said
        assert len(said) == 3

    def test_set_reaches_the_study(self) -> None:
        result = invoke("check", RIGHT, "--set", "rig.baselin=3 mm", "--set", "scene.distances=[0.2 m, 3 m]")
        assert result.exit_code == 2
        assert result.stderr == "--set:1:1: cameras.rig.baselin: unknown key; nearest: 'baseline'\n"
        assert "0.2 to 3 m" in invoke("check", RIGHT, "--set", "scene.distances=[0.2 m, 3 m]").stdout

    @pytest.mark.parametrize("path", ["huge.baseline", "cameras.huge.baseline"])
    def test_a_camera_that_does_not_exist_is_named_with_those_that_do(self, path: str) -> None:
        result = invoke("check", RIGHT, "--set", f"{path}=1 m")
        assert result.exit_code == 2
        (line,) = result.stderr.splitlines()
        assert line.startswith(f"--set:1:1: {path.removesuffix('.baseline')}: ")
        assert all(f"'{name}'" in line for name in ("rig", "array", "near"))

    @pytest.mark.parametrize(
        ("command", "study", "more"),
        [
            ("check", RIGHT, ["scipy"]),
            ("plan", RIGHT, ["scipy.fft", "scipy.spatial"]),
            ("plan", ROBOT.with_name("depth_loop.yaml"), []),
        ],
    )
    def test_loads_nothing_heavy(self, command: str, study: Path, more: list[str]) -> None:
        script = (
            "import sys; sys.argv, heavy = sys.argv[1:4], sys.argv[4:]\n"
            "from tradestudy import cli\n"
            "try: cli.main()\n"
            "except SystemExit as end: assert end.code == 0\n"
            "print(*[name for name in heavy if name in sys.modules])"
        )
        # Not jinja2, which pint loads wherever dask is installed; of ours, only the report does.
        heavy = ["xarray", "pandas", "matplotlib", "emcee", "typst", "tradestudy.report", *more]
        words = [sys.executable, "-c", script, "tradestudy", command, str(study), *heavy]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        assert done.stdout.splitlines()[-1] == ""


@pytest.mark.parametrize(("unit", "loaded"), [("m", False), ("yd", True)])
def test_loads_pint_only_for_units_that_need_it(unit: str, loaded: bool) -> None:
    script = (
        "import sys; sys.argv = sys.argv[1:]\n"
        "from tradestudy import cli\n"
        "try: cli.main()\n"
        "except SystemExit as end: assert not end.code, end.code\n"
        "import xarray; xarray.DataArray([1.0]).to_numpy()\n"
        "print(sys.modules['pint'] is not None)"
    )
    words = ["tradestudy", "check", str(RIGHT), "--set", f"rig.baseline=0.1 {unit}"]
    done = subprocess.run([sys.executable, "-c", script, *words], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == str(loaded)


class TestDask:
    SCRIPT = (
        "import sys; sys.argv = sys.argv[1:]\n"
        "from tradestudy import cli\n"
        "try: cli.main()\n"
        "except SystemExit: pass\n"
        "import xarray; xarray.Dataset({'a': ('x', [1.0])}) + 1.0\n"
        "print('dask' in sys.modules, sys.modules.get('dask'))"
    )

    def test_is_loaded_only_where_it_is_asked_for(self, tmp_path: Path) -> None:
        pytest.importorskip("dask")
        words = [sys.executable, "-c", self.SCRIPT, "tradestudy"]
        done = subprocess.run([*words, "check", str(RIGHT)], capture_output=True, text=True, check=True)
        assert done.stdout.splitlines()[-1] == "True None"
        run = ["run", str(RIGHT), "--out", str(tmp_path), "--dask", "nowhere"]
        done = subprocess.run([*words, *run], capture_output=True, text=True, check=True)
        assert "not the address of a Dask scheduler" in done.stderr
        assert "True <module 'dask'" in done.stdout

    def test_is_not_hidden_from_an_xarray_that_knows_of_it(self) -> None:
        pytest.importorskip("dask")
        words = [sys.executable, "-c", f"import xarray; {self.SCRIPT}", "tradestudy", "check", str(RIGHT)]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        assert not done.stdout.endswith("True None\n")


class TestRun:
    def test_passes_on_what_was_asked(self, ran: dict[str, Any], tmp_path: Path) -> None:
        result = invoke("run", RIGHT, "--out", tmp_path / "here", "--fresh", "--no-pdf", "--set", "rig.baseline=90 mm")
        assert result.exit_code == 0
        assert ran["directory"] == tmp_path / "here"
        assert ran["options"] == {
            "fresh": True,
            "pdf": False,
            "large_tables": False,
            "with_cost": False,
            "executor": None,
        }
        assert ran["study"].file.cameras["rig"].baseline == 0.09
        assert result.stdout == f"Best: a rig\nReport: {tmp_path / 'here' / 'report.html'}\n"

    def test_by_default_goes_where_the_study_is_named(self, ran: dict[str, Any]) -> None:
        assert invoke("run", RIGHT).exit_code == 0
        assert ran["directory"] == Path("reports") / "wrong"
        assert ran["options"] == {
            "fresh": False,
            "pdf": True,
            "large_tables": False,
            "with_cost": False,
            "executor": None,
        }

    def test_one_line_for_each_step_where_nobody_watches(self, ran: dict[str, Any]) -> None:
        assert invoke("run", RIGHT).stderr == "depth …\nreport …\n"

    def test_quiet_says_nothing(self, ran: dict[str, Any]) -> None:
        assert invoke("run", RIGHT, "--quiet").output == ""

    def test_strict_counts_only_when_asked(self, ran: dict[str, Any]) -> None:
        ran["unmet"] = ["close-range: near (5 %)"]
        assert invoke("run", RIGHT).exit_code == 0
        result = invoke("run", RIGHT, "--strict", "--quiet")
        assert (result.exit_code, result.output) == (3, "requirements not met: close-range: near (5 %)\n")

    def test_a_wrong_study_costs_nothing_already_there(self, ran: dict[str, Any], tmp_path: Path) -> None:
        old = tmp_path / "out" / "report.html"
        old.parent.mkdir()
        old.write_text("old")
        assert invoke("run", WRONG, "--out", old.parent).exit_code == 2
        assert old.read_text() == "old"
        assert "directory" not in ran

    @pytest.mark.parametrize(
        ("end", "status", "words"),
        [
            (KeyboardInterrupt(), 130, r"interrupted; .*"),
            (UnaffordableError("nodes", value="1e12", limit="1e9"), 2, r"nodes: 1e12 \(allowed: 1e9\)"),
            (NotConvergedError("the fit", remedy="start nearer"), 1, r"the fit; start nearer"),
            (ResultsError("truncated"), 1, r"truncated"),
        ],
    )
    def test_every_ending_has_its_status(
        self, ran: dict[str, Any], end: BaseException, status: int, words: str
    ) -> None:
        ran["ends"] = end
        result = invoke("run", RIGHT)
        assert result.exit_code == status
        assert re.fullmatch(rf"depth …\nreport …\n{words}\n", result.stderr)

    @pytest.mark.parametrize(
        "end", [RuntimeError("first line\nsecond line"), OSError(9, "Bad file descriptor"), MemoryError()]
    )
    def test_the_unexpected_is_one_line_and_a_log(self, ran: dict[str, Any], end: Exception, tmp_path: Path) -> None:
        ran["ends"] = end
        result = invoke("run", RIGHT, "--quiet")
        assert result.exit_code == 1
        line = re.fullmatch(r"unexpected (\w+)(.*); details are in (\S+)\n", result.stderr)
        assert line is not None
        assert line[1] == type(end).__name__
        log = Path(line[3]).read_text(encoding="utf-8")
        assert Path(line[3]).parent == tmp_path
        assert "Traceback" in log
        assert type(end).__name__ in log

    def test_the_unexpected_where_no_log_can_be_written(
        self, ran: dict[str, Any], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(tempfile, "tempdir", "/nowhere/at/all")
        ran["ends"] = RuntimeError("lost")
        reported = invoke("run", RIGHT, "--quiet").stderr
        assert re.fullmatch(r"unexpected RuntimeError: lost; .*\(No such file or directory\).* --debug .*\n", reported)

    def test_debug_shows_the_traceback(self, ran: dict[str, Any]) -> None:
        ran["ends"] = RuntimeError("shown")
        assert "Traceback" in invoke("run", RIGHT, "--debug").stderr
        assert "Traceback" in invoke("check", WRONG, "--debug").stderr

    def test_control_c_ends_a_real_run_at_once_and_leaves_no_report(self, tmp_path: Path) -> None:
        command = [sys.executable, "-m", "tradestudy", "run", str(ROBOT), "--out", str(tmp_path / "out")]
        # A shell may have started the tests in the background, where interrupts are ignored, by their children too.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as running:
            assert running.stderr is not None
            assert running.stderr.readline().endswith("…\n")
            running.send_signal(signal.SIGINT)
            rest = running.stderr.read()
        assert running.returncode == 130
        assert rest.splitlines()[-1].startswith("interrupted; ")
        assert "Traceback" not in rest
        assert not (tmp_path / "out" / "report.html").exists()

    def test_control_c_within_exec_exits_with_its_status_too(self, tmp_path: Path) -> None:
        # Python would end by the signal if the last exec that it ran had been interrupted.
        (tmp_path / "sitecustomize.py").write_text(
            "import sys\nclass Interrupting:\n    @staticmethod\n    def find_spec(module, path=None, target=None):\n"
            "        if module == 'tradestudy.cli':\n            exec('raise KeyboardInterrupt')\n"
            "sys.meta_path.insert(0, Interrupting)\n"
        )
        command = [sys.executable, "-m", "tradestudy"]
        ended = subprocess.run(command, env={**os.environ, "PYTHONPATH": str(tmp_path)}, check=False)
        assert ended.returncode == 130


def test_results_of_another_version_that_lack_something_are_refused(tmp_path: Path) -> None:
    result = api.load(RIGHT).run()
    for name, code in (("own", result.data.attrs["code_hash"]), ("other", "of an earlier version")):
        tree = result.data.copy()
        tree.attrs["code_hash"] = code
        tree["depth"] = xr.DataTree(tree["depth"].to_dataset().drop_vars("usable_near"))
        storage.write_finished(storage.encoded(tree), result.run_record, tmp_path / name)
    for command in (["report", "--no-pdf"], ["compare", tmp_path / "own"]):
        ended = invoke(*command, tmp_path / "other")
        assert ended.exit_code == 1
        reported = " ".join(ended.output.split())
        assert "from another version of the program and lack what this one shows" in reported
        assert str(tmp_path / "other") in reported
        assert reported.endswith("run the study again")
    broken = invoke("report", "--no-pdf", tmp_path / "own")
    assert broken.exit_code == 1
    assert "damaged: they lack" in " ".join(broken.output.split())
    assert "usable_near" in broken.output


class TestProgress:
    def test_a_log_names_a_step_once_even_if_another_one_comes_between(self) -> None:
        log = io.StringIO()
        line = shown_progress.ProgressLine(log)
        for step in ("claims", "claims", "requirements", "claims", "report"):
            line(step, 0.5)
        assert log.getvalue().splitlines() == ["claims …", "requirements …", "report …"]

    def test_short_work_shows_no_bar(self) -> None:
        bar = shown_progress.ProgressBar()
        bar("depth", 0.5)
        assert bar.progress is None

    def test_long_work_shows_a_bar_with_the_time_left(self, monkeypatch: pytest.MonkeyPatch) -> None:
        screen = io.StringIO()
        screen.isatty = lambda: True  # type: ignore[method-assign]  # a terminal to write on
        monkeypatch.setattr(sys, "stderr", screen)
        monkeypatch.setattr(shown_progress.ProgressBar, "WORTH_A_LOOK", 0.0)
        monkeypatch.setenv("TERM", "xterm")
        monkeypatch.setenv("COLUMNS", "80")
        with shown_progress.shown_progress(quiet=False) as progress:
            assert isinstance(progress, shown_progress.ProgressBar)
            progress("depth", 0.0)
            time.sleep(0.01)
            progress("depth", 0.25)
            progress("depth", 0.5)
            assert progress.progress is not None
            progress.progress.refresh()
        assert "depth" in screen.getvalue()
        assert "50%" in screen.getvalue()
        assert re.search(r"0:00:0\d", screen.getvalue())  # left

    def test_the_terminal_is_left_as_it_was_after_an_error(self, monkeypatch: pytest.MonkeyPatch) -> None:
        screen = io.StringIO()
        screen.isatty = lambda: True  # type: ignore[method-assign]  # a terminal to write on
        monkeypatch.setattr(sys, "stderr", screen)
        monkeypatch.setattr(shown_progress.ProgressBar, "WORTH_A_LOOK", 0.0)

        def fail() -> None:
            with shown_progress.shown_progress(quiet=False) as progress:
                progress("depth", 0.25)
                raise RuntimeError

        with pytest.raises(RuntimeError):
            fail()
        shown, hidden = (screen.getvalue().count(code) for code in ("\x1b[?25h", "\x1b[?25l"))
        assert shown == hidden


class TestNew:
    def test_writes_a_study_that_checks_and_runs(self, tmp_path: Path) -> None:
        result = invoke("new", "my-study")
        assert result.exit_code == 0
        assert result.stdout.splitlines()[0] == "my-study.yaml"
        assert invoke("check", tmp_path / "my-study.yaml").stdout.startswith("my-study: 2 cameras")
        assert invoke("run", "my-study.yaml", "--no-pdf", "--quiet").exit_code == 0

    @pytest.mark.parametrize("program", ["tradestudy", "python -m tradestudy"])
    def test_names_the_program_as_it_was_started(self, program: str) -> None:
        result = CliRunner().invoke(cli.app, ["new", "mine"], prog_name=program)
        assert result.stdout.splitlines()[1] == f"{program} run mine.yaml"

    def test_never_writes_over_a_file(self, tmp_path: Path) -> None:
        mine = tmp_path / "mine.yaml"
        mine.write_text("precious")
        result = invoke("new", "mine.yaml")
        assert result.exit_code == 2
        assert "mine.yaml; choose another" in result.stderr
        assert mine.read_text() == "precious"

    @pytest.mark.parametrize("name", ["../out", "a/b", "", ".", "..", "/tmp/x", "-", "a\nb", "x" * 300])
    def test_never_leaves_the_folder(self, name: str, tmp_path: Path) -> None:
        refused = invoke("new", "--", name)
        assert refused.exit_code == 2
        assert "cannot be the name of a study" in refused.stderr
        assert list(tmp_path.iterdir()) == []


def test_schema_is_json_that_names_the_parts_of_a_study() -> None:
    schema = json.loads(invoke("schema").stdout)
    assert {"cameras", "scene", "claims"} <= schema["properties"].keys()


def test_a_closed_pipe_causes_no_error_message() -> None:
    done = subprocess.Popen(
        [sys.executable, "-m", "tradestudy", "schema"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert done.stdout is not None
    assert done.stderr is not None
    done.stdout.close()
    with done.stderr:
        assert done.stderr.read() == b""
    assert done.wait() == 1


def test_report_without_results_says_so(tmp_path: Path) -> None:
    result = invoke("report", tmp_path)
    assert result.exit_code == 2
    assert result.stderr.count("\n") == 1
    assert str(tmp_path) in result.stderr


@pytest.mark.parametrize("words", [["chekc"], ["check"], ["run", "a", "b"], ["run", "a", "--pdff"], []])
def test_wrong_arguments_exit_with_2(words: list[str]) -> None:
    assert invoke(*words).exit_code == 2


def test_help_lists_the_commands() -> None:
    text = process("--help").stdout
    assert all(
        re.search(rf"^  {name} +[A-Z]", text, re.MULTILINE) for name in ("run", "check", "new", "report", "schema")
    )


def test_both_ways_to_start_the_program_print_the_version() -> None:
    reported = process("--version").stdout.split()
    assert reported == ["tradestudy", importlib.metadata.version("tradestudy")]
    assert invoke("--version").stdout.split() == reported
    assert reported[1] == tradestudy.__version__


@pytest.mark.parametrize("kind", ["--stereo", "--plenoptic"])
def test_new_writes_a_study_of_one_kind_whose_requirement_is_met(kind: str) -> None:
    assert invoke("new", "mine", kind).exit_code == 0
    text = Path("mine.yaml").read_text(encoding="utf-8")
    assert ("kind: stereo" in text) == (kind == "--stereo")
    found = invoke("run", "mine.yaml", "--no-pdf", "--strict")
    assert found.exit_code == 0, found.output


def test_the_package_lists_its_public_names() -> None:
    """What `tradestudy.<tab>` offers exists, and nothing else is offered."""
    assert dir(tradestudy) == sorted(tradestudy.__all__)
    assert all(hasattr(tradestudy, name) for name in dir(tradestudy))
