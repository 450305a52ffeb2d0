"""Points of a study: the same bits wherever they are computed, each kept as it finishes, none computed twice."""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import os
import pickle
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import tradestudy
from tests.execution.execution_points import LoggedPoint, compute, keys_on_disk, times_computed, workers
from tradestudy import api
from tradestudy.errors import OutOfRangeError, ResultsError, UnaffordableError
from tradestudy.execution import Checkpoints, DaskCluster, Executor, Processes, Serial, Steps, Threads
from tradestudy.execution.executor import UnavailableError
from tradestudy.execution.steps import FOLDER, DeadlyPointError, fingerprint, within_time
from tradestudy.shown_progress import shown_progress

pytestmark = pytest.mark.usefixtures("empty_figures")

SWEEP = """
format: 2
study: swept
title: T
question: Q
cameras:
  rig:
    kind: stereo
    title: Rig
    lenses: {focal_length: 8 mm, f_number: 4}
    sensor: {pixels: [2048, 2048], pixel_pitch: 5.5 um}
    baseline: 100 mm
    convergence_distance: 1 m
    focus_distance: autofocus
    principal_distance: focal_length
    depth: {estimator: disparity, disparity_error: 0.1 px, discrimination_step: 1 px}
    calibration: {errors: {yaw: {standard_deviation: 0.2 deg}}}
scene: {distances: {from: 0.3 m, to: 3 m, points: 12}, wavelength: 550 nm}
usable_range: {overlap: 80 %, failed_fraction: 2.5 %, relative_uncertainty: 10 %}
sweep:
  rig.baseline: {from: 50 mm, to: 200 mm, points: 4}
  rig.lenses.focal_length: {from: 5 mm, to: 20 mm, points: 6}
"""
POINTS = 4 * 6
FEW = ("sweep.rig.baseline.points=2", "sweep.rig.lenses.focal_length.points=3")
EXACT = """
format: 2
study: exact
title: T
question: Q
cameras:
  rig:
    kind: stereo
    title: Rig
    lenses: {focal_length: 30.5 mm, f_number: 8}
    sensor: {pixels: [1024, 1024], pixel_pitch: 10 um}
    baseline: 100 mm
    convergence_distance: infinity
    focus_distance: 1 m
    depth: {estimator: disparity, disparity_error: 0.1 px, discrimination_step: 0.1 px}
    calibration: {errors: {yaw: {standard_deviation: 0.2 deg}, roll: {half_width: 0.1 deg}}}
  r5:
    kind: focused-plenoptic
    title: R5
    main_lens: {focal_length: 12.5 mm, f_number: 3.8}
    sensor: {pixels: [2048, 2048], pixel_pitch: 5.5 um}
    microlenses: {layout: hexagonal, pitch: 126.5 um, gap: f-number-matching, types: 3}
    focus: {total_covering_plane: 150 mm, relay: keplerian}
    depth: {estimator: same-type-pair, disparity_error: 0.1 px, discrimination_step: 0.1 px}
    calibration:
      errors:
        mla_distance: {standard_deviation: 2 um}
        focal_length: {standard_deviation: 2 um}
        microlens_gap: {standard_deviation: 0.2 um}
      correlations: {mla_distance: {focal_length: 0.9}}
scene: {distances: {from: 0.3 m, to: 10 m, points: 5, spacing: log}, wavelength: 550 nm}
accuracy: {tolerance: 5 %}
effects: {calibration: exact}
propagation: {field_places: [50 %], max_draws: 4096}
sensitivity: {at: [0.5 m, 3 m]}
"""

OF_TWO = [
    pytest.param(lambda _shared: Serial(), id="serial"),
    pytest.param(lambda _shared: Threads(2), id="threads"),
    pytest.param(lambda shared: shared, id="processes"),
]


@pytest.fixture(scope="module")
def study_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("study") / "swept.yaml"
    path.write_text(SWEEP, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def serial(study_file: Path) -> api.Result:
    return tradestudy.load(study_file).run()


@pytest.fixture(scope="module")
def serial_few(study_file: Path) -> api.Result:
    return tradestudy.load(study_file, FEW).run()


@pytest.fixture(scope="module")
def written(serial: api.Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return serial.write(tmp_path_factory.mktemp("serial"), pdf=False)


@pytest.fixture(scope="module")
def cluster() -> Iterator[DaskCluster]:
    import dask
    from distributed import LocalCluster

    # A point may cost one worker; every further one takes seconds to start again.
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1}),
        LocalCluster(
            processes=True, n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50
        ) as local,
    ):
        yield DaskCluster(local.scheduler_address)


def test_a_run_that_reaches_its_time_limit_stops_and_keeps_what_is_finished(tmp_path: Path) -> None:
    done = points(tmp_path, 8, seconds=0.1)
    with contextlib.closing(Checkpoints(tmp_path / "run")) as checkpoints:
        watched = Steps(
            checkpoints=checkpoints,
            progress=within_time(lambda _step, _share: None, 0.3, "ask for less", time.monotonic()),
        )
        with pytest.raises(UnaffordableError, match=r"time limit: .* of the step 'counting' \(allowed: 0\.3 s\)"):
            watched.map("counting", compute, done, [f"number={one.number}" for one in done])
    with contextlib.closing(Checkpoints(tmp_path / "run")) as checkpoints:
        again = Steps(checkpoints=checkpoints)
        assert_same(again.map("counting", compute, done, [f"number={one.number}" for one in done]), 8)
    assert 0 < again.counts["counting"]["taken up"] < 8


def points(folder: Path, count: int, seconds: float = 0.0, **fates: str) -> list[LoggedPoint]:
    made = [LoggedPoint(folder=folder, number=number, seconds=seconds) for number in range(count)]
    for number, fate in fates.items():
        made[int(number[1:])] = replace(made[int(number[1:])], fate=fate)
    return made


def mapped(executor: Executor, of: list[LoggedPoint], checkpoints: Checkpoints | None = None) -> list[Any]:
    return Steps(executor=executor, checkpoints=checkpoints).map(
        "counting", compute, of, [f"number={one.number}" for one in of]
    )


def assert_same(values: list[Any], count: int) -> None:
    expected = [np.random.default_rng(number).normal(size=5) for number in range(count)]
    assert [value.tobytes() for value in values] == [value.tobytes() for value in expected]


def assert_same_results(one: api.Result, other: api.Result) -> None:
    assert one.run_record["inputs"] == other.run_record["inputs"]
    assert [group.path for group in one.data.subtree] == [group.path for group in other.data.subtree]
    for group in one.data.subtree:
        beside = other.data[group.path].to_dataset()
        for name, variable in group.to_dataset().variables.items():
            assert variable.dtype == beside[name].dtype
            assert variable.values.tobytes() == beside[name].values.tobytes() or variable.dtype == object, name
        xr.testing.assert_identical(group.to_dataset(), beside)


class TestExecutors:
    @pytest.mark.parametrize(
        "make",
        [
            pytest.param(lambda _shared: Threads(1), id="a thread"),
            pytest.param(lambda _shared: Threads(3), id="threads"),
            pytest.param(lambda _shared: Processes(1), id="a process"),
            pytest.param(lambda shared: shared, id="processes"),
        ],
    )
    def test_a_sweep_has_the_same_bits_everywhere(
        self, study_file: Path, serial_few: api.Result, make: Callable[[Processes], Executor], two_processes: Processes
    ) -> None:
        result = tradestudy.load(study_file, FEW).run(executor=make(two_processes))
        assert_same_results(serial_few, result)
        assert result.run_record["points"]["depth"] == {"computed": 3 * 4, "taken up": 0}  # with the declared values

    @pytest.mark.parametrize("make", OF_TWO)
    def test_values_stand_in_the_order_of_the_points(
        self, tmp_path: Path, make: Callable[[Processes], Executor], two_processes: Processes
    ) -> None:
        executor = make(two_processes)
        assert_same(mapped(executor, points(tmp_path, 20)), 20)
        assert times_computed(tmp_path) == dict.fromkeys(range(20), 1)
        assert mapped(executor, []) == []

    @pytest.mark.parametrize("make", OF_TWO)
    def test_the_first_refusal_is_told_whole(
        self, tmp_path: Path, make: Callable[[Processes], Executor], two_processes: Processes
    ) -> None:
        refused = points(tmp_path, 8, seconds=0.02, p2="is refused", p3="is refused")
        with pytest.raises(OutOfRangeError, match="the number: 2") as reported:
            mapped(make(two_processes), refused)
        assert str(reported.value) == "the number: 2 (allowed: another); choose it"
        assert (reported.value.value, reported.value.remedy) == ("2", "choose it")

    @pytest.mark.parametrize("make", OF_TWO)
    def test_a_point_that_ends_the_program_is_an_error_of_that_point(
        self, tmp_path: Path, make: Callable[[Processes], Executor], two_processes: Processes
    ) -> None:
        with pytest.raises(RuntimeError, match="tried to end the program with status 7"):
            mapped(make(two_processes), points(tmp_path, 6, p2="ends the program"))
        assert {0, 1} <= set(times_computed(tmp_path))

    def test_a_value_that_cannot_be_sent_is_an_error_of_its_own(self, tmp_path: Path) -> None:
        with pytest.raises(TypeError, match="cannot be sent"):
            mapped(Processes(2), points(tmp_path, 3, p1="cannot be sent"))

    def test_a_dead_process_costs_its_point_and_no_other(self, tmp_path: Path) -> None:
        assert_same(mapped(Processes(2), points(tmp_path, 12, seconds=0.02, p5="kills once")), 12)
        assert times_computed(tmp_path) == {**dict.fromkeys(range(12), 1), 5: 2}
        assert len(workers(tmp_path)) >= 2

    def test_workers_wait_for_further_points_and_dead_ones_are_replaced(self, tmp_path: Path) -> None:
        """Two steps are computed by the same processes, the third by new ones."""
        executor = Processes(2)
        own = []
        for number in range(3):
            folder = tmp_path / str(number)
            folder.mkdir()
            assert_same(mapped(executor, points(folder, 6, seconds=0.02)), 6)
            own.append(workers(folder))
            if number == 1:
                for process in own[0] | own[1]:
                    os.kill(process, signal.SIGKILL)
        assert len(own[0] | own[1]) <= 2
        assert not own[2] & own[1]

    def test_a_point_that_kills_again_and_again_is_named(self, tmp_path: Path) -> None:
        with pytest.raises(DeadlyPointError, match=r"^3 .*counting.*: number=3; .*kept"):
            mapped(Processes(2), points(tmp_path, 6, p3="kills always"))
        assert times_computed(tmp_path)[3] == 3

    @pytest.mark.parametrize("make", [Threads, Processes])
    @pytest.mark.parametrize("count", [0, -3])
    def test_fewer_than_one_worker_is_refused(self, make: Any, count: int) -> None:
        with pytest.raises(OutOfRangeError, match=f"{count} .allowed: 1 or more"):
            make(count)


def test_exact_draws_have_the_same_bits_everywhere_and_are_resumed(tmp_path: Path, two_processes: Processes) -> None:
    file = tmp_path / "exact.yaml"
    file.write_text(EXACT, encoding="utf-8")
    results = []
    for executor in (Serial(), two_processes):
        with contextlib.closing(Checkpoints(tmp_path / repr(executor))) as kept:
            results.append(tradestudy.load(file).run(executor=executor, checkpoints=kept))
    assert {"depth", "depth_field", "sensitivity"} <= set(results[0].data.children)
    assert_same_results(*results)
    with contextlib.closing(Checkpoints(tmp_path / repr(Serial()))) as kept:
        again = tradestudy.load(file).run(executor=Threads(2), checkpoints=kept)
    assert {counts["computed"] for counts in again.run_record["points"].values()} == {0}
    assert_same_results(results[0], again)


class TestDask:
    def test_a_cluster_computes_the_same_bits(
        self, study_file: Path, serial_few: api.Result, cluster: DaskCluster, tmp_path: Path
    ) -> None:
        cluster.check()
        assert_same_results(serial_few, tradestudy.load(study_file, FEW).run(executor=cluster))
        assert_same(mapped(cluster, points(tmp_path, 50, seconds=0.001)), 50)
        assert times_computed(tmp_path) == dict.fromkeys(range(50), 1)
        assert len(workers(tmp_path)) == 2

    def test_a_dead_worker_costs_its_point_and_a_deadly_point_is_named(
        self, cluster: DaskCluster, tmp_path: Path
    ) -> None:
        (tmp_path / "once").mkdir()
        (tmp_path / "always").mkdir()
        assert_same(mapped(cluster, points(tmp_path / "once", 8, seconds=0.25, p3="kills once")), 8)
        times = times_computed(tmp_path / "once")
        # A value that has not been fetched from the worker yet dies with it: that of the point before.
        assert times[3] == 2
        assert sorted(times) == list(range(8))
        assert 9 <= sum(times.values()) <= 10
        with pytest.raises(DeadlyPointError, match="number=2"):
            mapped(cluster, points(tmp_path / "always", 4, p2="kills always"))

    @pytest.mark.parametrize("address", ["", "foo", "127.0.0.1:80", "http://a:1", "tcp://a", "tcp://a b:1"])
    def test_what_is_no_address_is_refused_at_once(self, address: str) -> None:
        with pytest.raises(UnavailableError) as refused:
            DaskCluster(address).check()
        assert refused.value.value == repr(address)
        assert "tcp://" in refused.value.limit
        assert "scheduler" in refused.value.remedy

    def test_where_nothing_answers_is_refused_in_time(self) -> None:
        begin = time.monotonic()
        with pytest.raises(UnavailableError, match=r"no Dask scheduler answers: tcp://127.0.0.1:9;"):
            DaskCluster("tcp://127.0.0.1:9", timeout=0.5).check()
        assert time.monotonic() - begin < 5.0

    def test_without_dask_the_remedy_is_told(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "distributed", None)
        with pytest.raises(UnavailableError, match=r"pip install 'tradestudy\[dask\]'"):
            DaskCluster("tcp://127.0.0.1:9").check()


class TestFingerprint:
    def test_is_of_content_in_every_process(self, study_file: Path) -> None:
        script = (
            "import sys, tradestudy; from tradestudy.execution.steps import fingerprint\n"
            "definition = tradestudy.load(sys.argv[1]).prepared\n"
            "print(fingerprint(dict(definition.case.cameras), definition.file.cameras['rig']).hex())"
        )
        seed = "2" if os.environ.get("PYTHONHASHSEED") == "1" else "1"  # another than here
        reported = subprocess.run(
            [sys.executable, "-c", script, str(study_file)],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        here = tradestudy.load(study_file).prepared
        assert fingerprint(dict(here.case.cameras), here.file.cameras["rig"]).hex() == reported.strip()

    def test_tells_apart_what_differs(self) -> None:
        reported = [
            1, 1.0, True, "1", b"1", None, (1,), [1], ("ab", "c"), ("a", "bc"), {"a": 1}, {"a": 2}, {"b": 1},
            {"a": 1, "b": 2}, {"b": 2, "a": 1}, 0.0, -0.0, np.float64(1.0), np.array([1.0]), np.array([[1.0]]),
            np.array([1]), np.array(["1"]), compute, LoggedPoint, Path("1"), (("a",), "b"), ("a", ("b",)),
        ]  # fmt: skip
        reported = [one for one in reported if one is not LoggedPoint]
        assert len({fingerprint(one) for one in reported}) == len(reported)

    @pytest.mark.parametrize(
        "what",
        [lambda: None, object(), {1, 2}, np.array([None])],
        ids=["function", "object", "set", "array of objects"],
    )
    def test_refuses_what_it_cannot_tell_apart(self, what: object) -> None:
        with pytest.raises(TypeError, match="has no fingerprint"):
            fingerprint(what)


class TestCheckpoints:
    def test_finished_points_are_taken_up_and_no_other(self, tmp_path: Path) -> None:
        log = tmp_path / "log"
        log.mkdir()
        with pytest.raises(OutOfRangeError), contextlib.closing(Checkpoints(tmp_path)) as kept:
            mapped(Serial(), points(log, 10, p6="is refused"), kept)
        with contextlib.closing(Checkpoints(tmp_path)) as kept:
            assert_same(mapped(Processes(2), points(log, 10), kept), 10)
        assert times_computed(log) == {**dict.fromkeys(range(10), 1), 6: 2}
        with contextlib.closing(Checkpoints(tmp_path)) as kept:
            assert_same(mapped(Serial(), points(log, 10), kept), 10)
            kept.remove()
        assert sum(times_computed(log).values()) == 11
        assert not (tmp_path / FOLDER).exists()

    @pytest.mark.parametrize(
        "content", [pickle.dumps({"a": "dict"}), pickle.dumps(None), b"no pickle", pickle.dumps(eval)]
    )
    def test_saved_values_of_a_wrong_type_are_computed_again(
        self, content: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        log = tmp_path / "log"
        log.mkdir()
        with monkeypatch.context() as forged, contextlib.closing(Checkpoints(tmp_path)) as kept:
            forged.setattr("tradestudy.execution.steps.pickle.dumps", lambda *_, **__: content)
            mapped(Serial(), points(log, 3), kept)
        with contextlib.closing(Checkpoints(tmp_path)) as kept:
            assert_same(mapped(Serial(), points(log, 3), kept), 3)
        assert times_computed(log) == dict.fromkeys(range(3), 2)

    def test_what_is_damaged_is_computed_again_and_never_trusted(self, tmp_path: Path) -> None:
        log = tmp_path / "log"
        log.mkdir()
        with contextlib.closing(Checkpoints(tmp_path)) as kept:
            mapped(Serial(), points(log, 6), kept)
        (file,) = (tmp_path / FOLDER).iterdir()
        whole = file.read_bytes()
        rng = random.Random(0)
        size = len(whole) // 6
        for trial in range(60):
            broken = bytearray(whole)
            if trial % 2:
                del broken[rng.randrange(len(whole)) :]
                least = len(broken) // size
            else:
                broken[rng.randrange(len(whole))] ^= 1 << rng.randrange(8)
                least = 5
            file.write_bytes(broken)
            for path in log.iterdir():
                path.unlink()
            with contextlib.closing(Checkpoints(tmp_path)) as kept:
                steps = Steps(checkpoints=kept)
                assert_same(steps.map("counting", compute, points(log, 6), [""] * 6), 6)
            assert steps.counts["counting"]["taken up"] == least
            for path in (tmp_path / FOLDER).iterdir():
                if path != file:
                    path.unlink()

    def test_a_strangers_file_runs_nothing(self, tmp_path: Path) -> None:
        class Evil:
            def __reduce__(self) -> tuple[Any, ...]:
                return os.mkdir, (str(tmp_path / "evil"),)

        log = tmp_path / "log"
        log.mkdir()
        with contextlib.closing(Checkpoints(tmp_path)) as kept:
            mapped(Serial(), points(log, 1), kept)
            key = next(iter(keys_on_disk(tmp_path)))
            kept.add(key, Evil())
        with contextlib.closing(Checkpoints(tmp_path)) as kept:
            assert_same(mapped(Serial(), points(log, 1), kept), 1)
        assert not (tmp_path / "evil").exists()
        assert times_computed(log) == {0: 2}

    def test_another_living_run_keeps_its_points(self, tmp_path: Path) -> None:
        mine, theirs = Checkpoints(tmp_path), Checkpoints(tmp_path)
        mine.add(bytes(32), 1.0)
        theirs.add(bytes(range(32)), 2.0)
        mine.remove()
        with contextlib.closing(Checkpoints(tmp_path)) as left:
            assert left.finished([bytes(32), bytes(range(32))]) == {1: 2.0}
        theirs.add(bytes([1] * 32), 3.0)
        theirs.close()  # as a kill would
        fresh = Checkpoints(tmp_path, fresh=True)
        assert not (tmp_path / FOLDER).exists()
        assert fresh.finished([bytes([1] * 32)]) == {}

    def test_a_log_says_what_a_resumed_run_takes_up(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        all_points = points(tmp_path, 5)
        for of in (all_points[:3], all_points):  # the first run is stopped after three of five points
            log = io.StringIO()
            monkeypatch.setattr(sys, "stderr", log)
            with contextlib.closing(Checkpoints(tmp_path / "run")) as kept, shown_progress(quiet=False) as progress:
                steps = Steps(checkpoints=kept, progress=progress)
                assert_same(steps.map("counting", compute, of, [""] * len(of)), len(of))
            taken = ["counting: 3 of 5 parts taken from an interrupted run"] if of is all_points else []
            assert log.getvalue().splitlines() == ["counting …", *taken]

    def test_keeping_cheap_points_costs_little(self, tmp_path: Path) -> None:
        log = tmp_path / "log"
        log.mkdir()
        cheap = [replace(one, works=True) for one in points(log, 400, seconds=0.001)]
        begin = time.process_time()
        mapped(Serial(), cheap)
        without = time.process_time() - begin
        begin = time.process_time()
        with contextlib.closing(Checkpoints(tmp_path)) as kept:
            mapped(Serial(), cheap, kept)
        assert time.process_time() - begin < 1.3 * without  # a tenth is measured; a busy machine may need more


class TestCommand:
    def command(self, study_file: Path, out: Path, *more: str) -> list[str]:
        return [
            sys.executable, "-m", "tradestudy", "run", str(study_file), "--out", str(out), "--no-pdf", "--quiet", *more,
        ]  # fmt: skip

    def stop_after_some(self, study_file: Path, out: Path, how: int, *more: str) -> tuple[int, str, int]:
        """Status, complaint and the number of points on disk of a run that is stopped on its way."""
        with subprocess.Popen(self.command(study_file, out, *more), stderr=subprocess.PIPE, text=True) as running:
            while running.poll() is None and not ((out / FOLDER).is_dir() and len(keys_on_disk(out)) >= 3):
                time.sleep(0.005)
            running.send_signal(how)
            assert running.stderr is not None
            reported = running.stderr.read()
        return running.returncode, reported, len(keys_on_disk(out))

    @pytest.mark.parametrize(
        ("how", "first", "second"),
        [
            (signal.SIGKILL, (), ("--threads", "2")),
            (signal.SIGTERM, ("--jobs", "2"), ()),
            (signal.SIGKILL, ("--jobs", "2"), ("--jobs", "2")),
        ],
    )
    @pytest.mark.slow
    def test_a_stopped_run_is_taken_up_point_by_point(
        self,
        study_file: Path,
        serial: api.Result,
        written: Path,
        tmp_path: Path,
        how: int,
        first: tuple[str, ...],
        second: tuple[str, ...],
    ) -> None:
        out = tmp_path / "out"
        status, reported, kept = self.stop_after_some(study_file, out, how, *first)
        assert 3 <= kept < POINTS
        if how == signal.SIGKILL:
            assert (status, reported) == (-how, "")
        else:
            assert status == 130
            assert re.fullmatch(r"interrupted; .*\n", reported)
        assert [path.name for path in out.iterdir()] == [FOLDER]
        done = subprocess.run(
            self.command(study_file, out, *second), capture_output=True, text=True, timeout=60, check=False
        )
        assert (done.returncode, done.stderr) == (0, "")
        again = tradestudy.open_result(out)
        assert again.run_record["points"]["depth"] == {"computed": POINTS - kept, "taken up": kept}
        assert again.run_record["inputs"] == serial.run_record["inputs"]
        assert (out / "results.nc").read_bytes() == (written / "results.nc").read_bytes()
        assert not (out / FOLDER).exists()

    def test_results_whose_bytes_have_changed_are_refused_and_computed_again(self, tmp_path: Path) -> None:
        study = tmp_path / "hard.yaml"  # whose report is written quickly
        study.write_text("format: 2\nstudy: hard\ntitle: T\nquestion: Q\nhard_cases: {families: [equation-27]}\n")
        api.run(tradestudy.load(study), tmp_path, pdf=False)
        path = tmp_path / "results.nc"
        whole = path.read_bytes()
        assert json.loads((tmp_path / "run.json").read_text())["results_sha256"] == hashlib.sha256(whole).hexdigest()
        rng = random.Random(0)
        for _ in range(20):
            broken = bytearray(whole)
            broken[rng.randrange(len(whole))] ^= 1 << rng.randrange(8)
            path.write_bytes(broken)
            with pytest.raises(ResultsError, match="run the study again"):
                tradestudy.open_result(tmp_path)
        api.run(tradestudy.load(study), tmp_path, pdf=False)
        assert path.read_bytes() == whole

    @pytest.mark.parametrize(
        ("words", "reported"),
        [
            (("--jobs", "0"), "number of worker processes: 0 (allowed: 1 or more)"),
            (("--threads", "-1"), "number of threads: -1 (allowed: 1 or more)"),
            (("--jobs", "2", "--dask", "tcp://127.0.0.1:9"), "exclude each other: --jobs and --dask"),
            (("--jobs", "2", "--threads", "2"), "exclude each other: --jobs and --threads"),
            (("--dask", "foo"), "not the address of a Dask scheduler: 'foo' (allowed: addresses such as tcp://"),
        ],
    )
    def test_impossible_workers_are_refused_before_anything_is_written(
        self, study_file: Path, tmp_path: Path, words: tuple[str, ...], reported: str
    ) -> None:
        from typer.testing import CliRunner

        from tradestudy import cli

        result = CliRunner().invoke(cli.app, ["run", str(study_file), "--out", str(tmp_path / "out"), *words])
        assert result.exit_code == 2
        assert reported in result.stderr
        assert result.stderr.count("\n") == 1
        assert not (tmp_path / "out").exists()
