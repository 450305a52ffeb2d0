"""Faults: runs that are killed, interrupted, starved of disk, or in each other's way lose nothing and resume.

    python -m tests.campaigns.faults --kills 60

After every fault the folder is looked through: each file that carries its final name is whole, finished results are
still there; then the study is run again, must not compute what was finished, and must end in the same bytes. Figures go
to faults.md beside this file.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path

import h5py
import pypdfium2
import xarray as xr

from tests.campaigns import record
from tests.execution.execution_points import keys_on_disk
from tradestudy.execution.steps import FOLDER as UNFINISHED
from tradestudy.verification.study_files import study

PATIENCE = 240.0  # s, for one run on a busy machine
STUDY = study(scene="{distances: {from: 1 m, to: 4 m, points: 30}, wavelength: 550 nm}", name="faults")
SWEEP = STUDY + "sweep: {rig.baseline: {from: 50 mm, to: 200 mm, points: 25}}\n"
STOPS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
DISK = 8 * 1024 * 1024
BROKEN = ("half-written", "lost", "recomputed", "different", "badly ended")

Prepare = Callable[["Bench", Path], None]


@dataclass(kw_only=True)
class Row:
    """One kind of fault: how often it was tried, and what went wrong."""

    fault: str
    trials: int = 0
    wrong: Counter[str] = field(default_factory=Counter)
    details: list[str] = field(default_factory=list)
    note: str = ""

    def blame(self, what: str, detail: str) -> None:
        self.wrong[what] += 1
        self.details.append(f"{self.fault}: {what}: {detail}")


@dataclass(kw_only=True)
class Bench:
    """A study, its results as they are when nothing goes wrong, and a place to break things."""

    root: Path
    rng: random.Random
    text: str = STUDY
    pdf: bool = True
    seconds: float = 0.0

    def __post_init__(self) -> None:
        self.root.mkdir(exist_ok=True)
        self.study, self.other = self.root / "study.yaml", self.root / "other.yaml"
        self.study.write_text(self.text, encoding="utf-8")
        self.other.write_text(self.text.replace("title: T", "title: Another"), encoding="utf-8")
        self.right = self.root / "right"
        begin = time.monotonic()
        assert self.run(self.right).returncode == 0
        self.seconds = time.monotonic() - begin

    @cached_property
    def stranger(self) -> Path:
        """A finished run of another study."""
        out = self.root / "stranger"
        assert self.run(out, self.other).returncode == 0
        return out

    def command(self, out: Path, file: Path | None = None) -> list[str]:
        command = [sys.executable, "-m", "tradestudy", "run", str(file or self.study), "--out", str(out), "--quiet"]
        return command if self.pdf else [*command, "--no-pdf"]

    def run(self, out: Path, file: Path | None = None, **more: object) -> subprocess.CompletedProcess[str]:
        return subprocess.run(  # type: ignore[call-overload,no-any-return]  # keywords of any kind
            self.command(out, file), capture_output=True, text=True, timeout=PATIENCE, check=False, **more
        )

    def start(self, out: Path, *more: str) -> subprocess.Popen[str]:
        command = [*self.command(out), *more]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)

    def moment(self) -> float:
        return self.rng.uniform(0.05, 1.05) * self.seconds

    def fresh(self) -> Path:
        return Path(tempfile.mkdtemp(dir=self.root)) / "out"


def empty(_bench: Bench, _out: Path) -> None:
    """Nothing is there."""


def finished(bench: Bench, out: Path) -> None:
    """A finished run of the same study is there."""
    shutil.copytree(bench.right, out)


def of_another_study(bench: Bench, out: Path) -> None:
    """A finished run of another study is there."""
    shutil.copytree(bench.stranger, out)


START_FROM: tuple[Prepare, ...] = (empty, finished, of_another_study)


def half_written(folder: Path) -> list[str]:
    """Files under their final names that are not whole."""
    broken = []
    for path in sorted(folder.rglob("*")) if folder.is_dir() else []:
        if path.is_dir() or path.name.endswith(".part") or path.parent.name == UNFINISHED:
            continue
        try:
            if path.suffix == ".nc":
                with xr.open_datatree(path, engine="h5netcdf") as opened:
                    opened.load()
            elif path.suffix == ".json":
                json.loads(path.read_text(encoding="utf-8"))
            elif path.suffix == ".pdf":
                assert len(pypdfium2.PdfDocument(path)) > 0
            elif path.suffix in (".html", ".svg"):
                assert path.read_text(encoding="utf-8").rstrip().endswith(f"</{path.suffix[1:]}>")
            else:
                assert path.read_text(encoding="utf-8").endswith("\n")
        except (OSError, ValueError, KeyError, RuntimeError, AssertionError, pypdfium2.PdfiumError) as error:
            broken.append(f"{path.name}: {error}")
    return broken


def is_finished(bench: Bench, out: Path) -> bool:
    """Whether the results of the study are there, whole."""
    results = out / "results.nc"
    return results.is_file() and results.read_bytes() == (bench.right / "results.nc").read_bytes()


def started(out: Path) -> str:
    """When the results of a folder were begun to be computed; empty where no record says."""
    try:
        return str(json.loads((out / "run.json").read_text(encoding="utf-8"))["started"])
    except (OSError, ValueError, KeyError):
        return ""


def look_and_resume(bench: Bench, row: Row, out: Path, *, was_finished: bool, before: str = "") -> None:
    """Look through a folder after a fault, run the study again, and compare with a run that nothing disturbed."""
    row.trials += 1
    for broken in half_written(out):
        row.blame("half-written", broken)
    there = is_finished(bench, out)
    if was_finished and not there:
        row.blame("lost", "finished results are gone")
    begun = started(out)
    if was_finished and before and begun != before:
        row.blame("recomputed", f"begun {before}, now {begun}, in the run that was disturbed")
    again = bench.run(out)
    if again.returncode != 0:
        row.blame("badly ended", f"the rerun: {again.returncode} {again.stderr.strip()[-200:]}")
        return
    if there and started(out) != begun:
        row.blame("recomputed", f"begun {begun}, now {started(out)}")
    if not is_finished(bench, out):
        row.blame("different", "results.nc after the rerun")
    for path in sorted(bench.right.rglob("*")):
        if path.suffix in (".svg", ".csv") and path.read_bytes() != (out / path.relative_to(bench.right)).read_bytes():
            row.blame("different", path.name)
    for left in out.rglob("*.part"):
        row.blame("half-written", f"{left.name} is left after the rerun")


def one_line(row: Row, status: int, expected: tuple[int, ...], stderr: str) -> None:
    """The disturbed run ended as it should: by its status, in one line, without a traceback."""
    if status not in expected or "Traceback" in stderr or len(stderr.strip().splitlines()) > 1:
        row.blame("badly ended", f"{status}: {stderr.strip()[-300:]}")


def killed(bench: Bench, trials: int) -> Row:
    """SIGKILL at random moments."""
    row = Row(fault="kill −9 at a random moment")
    where: Counter[str] = Counter()
    for trial in range(trials):
        out = bench.fresh()
        prepare = START_FROM[trial % len(START_FROM)]
        prepare(bench, out)
        before = started(out) if prepare is finished else ""
        process = bench.start(out)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=bench.moment())
        process.kill()
        process.communicate()
        where["already ended" if process.returncode == 0 else _phase(bench, out, prepare)] += 1
        look_and_resume(bench, row, out, was_finished=prepare is finished, before=before)
        shutil.rmtree(out.parent)
    row.note = ", ".join(f"{count} {phase}" for phase, count in sorted(where.items()))
    return row


def _phase(bench: Bench, out: Path, prepare: Prepare) -> str:
    """How far a killed run had come, by its folder."""
    if prepare is finished:
        return "over finished results"
    if is_finished(bench, out):
        return "after its results were written"
    return "before its results were written"


def interrupted(bench: Bench, trials: int) -> Row:
    """SIGINT at random moments: 130, one line, nothing left behind at once."""
    row = Row(fault="Ctrl-C at a random moment")
    early = 0
    for trial in range(trials):
        out = bench.fresh()
        prepare = START_FROM[trial % len(START_FROM)]
        prepare(bench, out)
        process = bench.start(out)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(timeout=bench.moment())
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=PATIENCE)
        if process.returncode == -signal.SIGINT and not stderr.strip():
            early += 1  # Python itself was still starting: the shell sees 130 too
        else:
            one_line(row, process.returncode, (0, 130), stderr)
        for left in out.rglob("*.part"):
            row.blame("half-written", f"{left.name} is left by an interrupted run")
        look_and_resume(bench, row, out, was_finished=prepare is finished)
        shutil.rmtree(out.parent)
    row.note = f"{early} before Python had started the program"
    return row


@contextlib.contextmanager
def small_disk(size: int) -> Iterator[Path]:
    """A file system in memory, where this process may make one."""
    with tempfile.TemporaryDirectory() as folder:
        mounted = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder], capture_output=True, check=False
        )
        if mounted.returncode != 0:
            raise PermissionError(mounted.stderr.decode())
        try:
            yield Path(folder)
        finally:
            subprocess.run(["umount", folder], check=True)


def disk_full(bench: Bench, trials: int) -> Row:
    """A file system that is full at some point of the writing, then is given room."""
    row = Row(fault="disk full")
    written = sum(path.stat().st_size for path in bench.right.rglob("*") if path.is_file())
    for trial in range(trials):
        prepare = START_FROM[trial % len(START_FROM)]
        try:
            with small_disk(DISK) as disk:
                out = disk / "out"
                prepare(bench, out)
                used = sum(path.stat().st_blocks * 512 for path in disk.rglob("*"))
                room = used + int(bench.rng.uniform(0.0, 0.9) * written)
                subprocess.run(["mount", "-o", f"remount,size={max(room, 4096)}", str(disk)], check=True)
                starved = bench.run(out)
                one_line(row, starved.returncode, (0, 1), starved.stderr)
                for left in out.rglob("*.part"):
                    row.blame("half-written", f"{left.name} is left on a full disk")
                subprocess.run(["mount", "-o", f"remount,size={DISK}", str(disk)], check=True)
                look_and_resume(bench, row, out, was_finished=prepare is finished)
        except PermissionError as error:
            row.note = f"no file system could be mounted ({error})"
            return row
    return row


def file_too_large(bench: Bench, trials: int) -> Row:
    """A limit on the size of files, as a quota sets one."""
    row = Row(fault="file size limit")
    for trial in range(trials):
        out = bench.fresh()
        prepare = START_FROM[trial % len(START_FROM)]
        prepare(bench, out)
        limit = bench.rng.randrange(100, 40_000)
        starved = bench.run(out, preexec_fn=partial(resource.setrlimit, resource.RLIMIT_FSIZE, (limit, limit)))
        one_line(row, starved.returncode, (0, 1), starved.stderr)
        for left in out.rglob("*.part"):
            row.blame("half-written", f"{left.name} is left by a run that could not write")
        look_and_resume(bench, row, out, was_finished=prepare is finished)
        shutil.rmtree(out.parent)
    return row


def read_only(bench: Bench, trials: int) -> Row:
    """An output folder that cannot be written: by a read-only file system, or for want of rights."""
    row = Row(fault="read-only output folder")
    for trial in range(trials):
        prepare = START_FROM[trial % len(START_FROM)]
        try:
            with _locked_folder(bench, prepare) as (out, set_writable):
                kept = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
                refused = bench.run(out)
                one_line(row, refused.returncode, (1,), refused.stderr)
                if {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} != kept:
                    row.blame("lost", "a folder that cannot be written has changed")
                set_writable()
                look_and_resume(bench, row, out, was_finished=prepare is finished)
        except PermissionError as error:
            row.note = f"no folder could be made read-only ({error})"
            return row
    return row


@contextlib.contextmanager
def _locked_folder(bench: Bench, prepare: Prepare) -> Iterator[tuple[Path, Callable[[], None]]]:
    if os.geteuid() == 0:  # to whom rights mean nothing
        with small_disk(DISK) as disk:
            prepare(bench, disk / "out")
            (disk / "out").mkdir(exist_ok=True)
            subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
            yield disk / "out", lambda: _remount(disk)
        return
    out = bench.fresh()
    prepare(bench, out)
    out.mkdir(exist_ok=True)
    folders = [out, *(path for path in out.iterdir() if path.is_dir())]

    def set_mode(mode: int) -> None:
        for folder in folders:
            folder.chmod(mode)

    set_mode(0o555)
    yield out, lambda: set_mode(0o755)
    shutil.rmtree(out.parent)


def _remount(disk: Path) -> None:
    subprocess.run(["mount", "-o", "remount,rw", str(disk)], check=True)


def truncated(bench: Bench, trials: int) -> Row:
    """Results, or their record, cut short: refused by `report` in one line, computed anew by `run`."""
    row = Row(fault="results or record truncated")
    for trial in range(trials):
        out = bench.fresh()
        finished(bench, out)
        path = out / ("results.nc", "run.json")[trial % 2]
        whole = path.read_bytes()
        path.write_bytes(whole[: bench.rng.randrange(len(whole) - 1)])
        _refused_then_resumed(bench, row, out)
    return row


def another_version(bench: Bench, trials: int) -> Row:
    """Results of another format version."""
    row = Row(fault="results of another version")
    for trial in range(trials):
        out = bench.fresh()
        finished(bench, out)
        with h5py.File(out / "results.nc", "r+") as file:
            file.attrs["format_version"] = (0, 2, 999)[trial % 3]
        reported = json.loads((out / "run.json").read_text(encoding="utf-8"))
        reported["results_sha256"] = hashlib.sha256((out / "results.nc").read_bytes()).hexdigest()
        (out / "run.json").write_text(json.dumps(reported), encoding="utf-8")
        _refused_then_resumed(bench, row, out)
    return row


def _refused_then_resumed(bench: Bench, row: Row, out: Path) -> None:
    report = subprocess.run(
        [sys.executable, "-m", "tradestudy", "report", str(out), "--no-pdf"],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    one_line(row, report.returncode, (1,), report.stderr)
    if "run the study again" not in report.stderr:
        row.blame("badly ended", f"no remedy: {report.stderr.strip()}")
    row.trials += 1
    again = bench.run(out)
    if again.returncode != 0 or not is_finished(bench, out):
        row.blame("different", f"after the rerun: {again.returncode} {again.stderr.strip()[-200:]}")
    shutil.rmtree(out.parent)


def two_at_once(bench: Bench, trials: int) -> Row:
    """Two runs of the same study into the same folder."""
    row = Row(fault="two runs on one folder at once")
    for trial in range(trials):
        out = bench.fresh()
        START_FROM[trial % len(START_FROM)](bench, out)
        first = bench.start(out)
        time.sleep(bench.rng.uniform(0.0, 0.3) * bench.seconds)
        second = bench.start(out)
        for process in (first, second):
            _, stderr = process.communicate(timeout=PATIENCE)
            one_line(row, process.returncode, (0,), stderr)
        if not is_finished(bench, out):
            row.blame("lost", "two runs left no finished results")
        for left in out.rglob("*.part"):
            row.blame("half-written", f"{left.name} is left by two runs")
        look_and_resume(bench, row, out, was_finished=True)
        shutil.rmtree(out.parent)
    return row


def flipped(bench: Bench, trials: int) -> Row:
    """Bits of the results changed where they lie: refused by `report` in one line, computed anew by `run`."""
    row = Row(fault="bits of the results flipped")
    for _ in range(trials):
        out = bench.fresh()
        finished(bench, out)
        broken = bytearray((out / "results.nc").read_bytes())
        for _ in range(bench.rng.choice((1, 1, 3000))):
            broken[bench.rng.randrange(len(broken))] ^= 1 << bench.rng.randrange(8)
        (out / "results.nc").write_bytes(broken)
        _refused_then_resumed(bench, row, out)
    return row


def points_of_record(out: Path) -> dict[str, int]:
    """How many points of the sweep the finished run computed, and how many it took up."""
    counts: dict[str, int] = json.loads((out / "run.json").read_text(encoding="utf-8"))["points"]["depth"]
    return counts


def stopped_in_a_sweep(bench: Bench, trials: int) -> Row:
    """SIGKILL, SIGTERM and SIGINT amid a sweep, serial and on workers: the rerun computes what is missing, no more."""
    row = Row(fault="sweep stopped amid its points")
    stops = [(how, more) for more in ((), ("--jobs", "2"), ("--threads", "2")) for how in STOPS]
    total = sum(points_of_record(bench.right).values())
    taken = 0
    for trial in range(trials):
        out = bench.fresh()
        how, more = stops[trial % len(stops)]
        process = bench.start(out, *more)
        _wait_for_points(process, out, bench.rng.randrange(1, total))
        process.send_signal(how)
        _, stderr = process.communicate(timeout=PATIENCE)
        if how != signal.SIGKILL:
            one_line(row, process.returncode, (0, 130), stderr)
        kept = len(keys_on_disk(out))
        look_and_resume(bench, row, out, was_finished=False)
        if process.returncode != 0:
            counts = points_of_record(out)
            taken += counts["taken up"]
            if counts != {"computed": total - kept, "taken up": kept}:
                row.blame("recomputed", f"{kept} of {total} points on disk, then {counts}")
        _see_that_it_vanished(row, out)
        shutil.rmtree(out.parent)
    row.note = f"{taken} finished points taken up, none computed again" if not row.wrong["recomputed"] else ""
    return row


def process_killed(bench: Bench, trials: int) -> Row:
    """One of two worker processes is killed amid a sweep: the run goes on and ends as if nothing had happened."""
    row = Row(fault="kill −9 of one of two worker processes")
    for _ in range(trials):
        out = bench.fresh()
        process = bench.start(out, "--jobs", "2")
        _wait_for_points(process, out, bench.rng.randrange(1, 20))
        workers = _worker_processes(process.pid)
        if workers:
            with contextlib.suppress(ProcessLookupError):
                os.kill(bench.rng.choice(workers), signal.SIGKILL)
        _, stderr = process.communicate(timeout=PATIENCE)
        _ended_well(bench, row, out, process.returncode, stderr)
    return row


def dask_worker_killed(bench: Bench, trials: int) -> Row:
    """One of two Dask workers is killed amid a sweep."""
    from distributed import LocalCluster

    row = Row(fault="kill −9 of one of two Dask workers")
    with LocalCluster(
        processes=True, n_workers=2, threads_per_worker=1, dashboard_address=":0", silence_logs=50
    ) as cluster:
        for trial in range(trials):
            out = bench.fresh()
            process = bench.start(out, "--dask", cluster.scheduler_address)
            _wait_for_points(process, out, bench.rng.randrange(1, 20))
            os.kill(cluster.workers[trial % 2].pid, signal.SIGKILL)
            _, stderr = process.communicate(timeout=PATIENCE)
            _ended_well(bench, row, out, process.returncode, stderr)
            while len(cluster.scheduler_info["workers"]) < 2:  # the killed one is started again
                time.sleep(0.1)
    return row


def _ended_well(bench: Bench, row: Row, out: Path, status: int, stderr: str) -> None:
    row.trials += 1
    one_line(row, status, (0,), stderr)
    total = sum(points_of_record(bench.right).values())
    if status == 0 and points_of_record(out) != {"computed": total, "taken up": 0}:
        row.blame("recomputed", f"{points_of_record(out)} of {total} points")
    if not is_finished(bench, out):
        row.blame("different", "results.nc of the run that lost a worker")
    _see_that_it_vanished(row, out)
    shutil.rmtree(out.parent)


def _see_that_it_vanished(row: Row, out: Path) -> None:
    if (out / UNFINISHED).exists():
        row.blame("half-written", f"{UNFINISHED} is left beside finished results")


def _wait_for_points(process: subprocess.Popen[str], out: Path, count: int) -> None:
    while process.poll() is None and len(keys_on_disk(out)) < count:
        time.sleep(0.01)


def _worker_processes(run: int) -> list[int]:
    """Children of a run that compute for it, and not the one that keeps track of its resources."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            parent = int((path / "stat").read_text().rpartition(")")[2].split()[1])
            if parent == run and b"spawn_main" in (path / "cmdline").read_bytes():
                found.append(int(path.name))
    return found


def campaign(root: Path, *, kills: int, others: int, seed: int) -> list[Row]:
    """All faults."""
    bench = Bench(root=root, rng=random.Random(seed))
    faults = (interrupted, disk_full, file_too_large, read_only, truncated, flipped, another_version, two_at_once)
    sweep = Bench(root=root / "sweep", rng=bench.rng, text=SWEEP, pdf=False)
    tried = [(killed, bench, kills), *((fault, bench, others) for fault in faults)]
    tried += [(fault, sweep, others) for fault in (stopped_in_a_sweep, process_killed, dask_worker_killed)]
    rows = []
    for fault, where, trials in tried:
        rows.append(fault(where, trials))
        print(f"{rows[-1].fault}: {rows[-1].trials} trials, {sum(rows[-1].wrong.values())} wrong", file=sys.stderr)
    return rows


def main() -> None:
    """Run the campaign and keep its figures."""
    parser = argparse.ArgumentParser(description="Break runs in every way, and see that nothing is lost.")
    parser.add_argument("--kills", type=int, default=60)
    parser.add_argument("--others", type=int, default=9)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        rows = campaign(Path(folder), kills=asked.kills, others=asked.others, seed=asked.seed)
    path = record.write(
        "faults",
        "Faults: what was tried, and what was lost",
        f"python -m tests.campaigns.faults --kills {asked.kills} --others {asked.others} --seed {asked.seed}",
        (
            "Fault",
            "Trials",
            "Half-written files",
            "Finished results lost",
            "Finished results recomputed",
            "Results different",
            "Ended badly",
            "Note",
        ),
        [(row.fault, row.trials, *(row.wrong[what] for what in BROKEN), row.note) for row in rows],
    )
    print(path.read_text(encoding="utf-8"))
    details = [detail for row in rows for detail in row.details]
    print("\n".join(details))
    sys.exit(1 if details else 0)


if __name__ == "__main__":
    main()
