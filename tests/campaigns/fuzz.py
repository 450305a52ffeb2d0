"""Bad input in bulk: mutated and invented study files through `check` and `plan`, in process.

    python -m tests.campaigns.fuzz --inputs 20000

Whatever is fed in, `check` says what the study holds and `plan` what it would compute, or they refuse it in words:
never another exception or a warning, never longer than ten seconds of processor time, never beyond a gigabyte, never
writing, moving or starting anything. Inputs come from two sources: mutations of the shipped studies (text, values,
structure, splices, hostile YAML) and studies that hypothesis invents from the schema's own keys. Figures go to fuzz.md
beside this file; an input that breaks a rule is kept.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tests.campaigns import record
from tests.campaigns.invented import invent
from tests.campaigns.mutations import Corpus, mutated
from tradestudy import api
from tradestudy.errors import StudyError, TradestudyError

LONGEST_SECONDS = 10.0  # of processor time, which other work on the machine does not prolong
LONGEST_WAIT = 60.0
MOST_BYTES = 2**30
INVENTED_SHARE = 0.2


class HangError(BaseException):
    """An input took longer than it may; not an Exception, so that nothing swallows it."""


@dataclass(kw_only=True)
class Tally:
    """What came of the inputs."""

    inputs: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    findings: list[str] = field(default_factory=list)
    slowest: float = 0.0
    by_source: Counter[str] = field(default_factory=Counter)

    def find(self, source: str, kind: str, detail: str) -> None:
        self.outcomes[kind] += 1
        self.findings.append(f"input {self.inputs} ({source}): {kind}: {detail}")


class Watch:
    """Records everything that a watched block does to the world: an audit hook cannot be taken out again."""

    _CHANGES = ("os.remove", "os.rename", "os.mkdir", "os.rmdir", "os.link", "os.symlink", "os.chmod", "os.truncate")
    _STARTS = ("subprocess.Popen", "os.system", "os.exec", "os.posix_spawn", "os.fork", "socket.connect")

    def __init__(self) -> None:
        self.on, self.seen = False, list[str]()
        sys.addaudithook(self._audit)

    @contextlib.contextmanager
    def watching(self) -> Iterator[list[str]]:
        compiles, sys.dont_write_bytecode = sys.dont_write_bytecode, True  # of modules that are imported late
        self.seen, self.on = [], True
        try:
            yield self.seen
        finally:
            self.on, sys.dont_write_bytecode = False, compiles

    def _audit(self, event: str, arguments: tuple[Any, ...]) -> None:
        if not self.on:
            return
        if event == "open":
            path, mode, flags = arguments
            writes = (
                set(mode) & set("wax+") if isinstance(mode, str) else flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
            )
            if writes:
                self.seen.append(f"opens {path} to write")
        elif event in self._CHANGES + self._STARTS:
            self.seen.append(f"{event} {arguments}")


def _outcome(path: Path, overrides: tuple[str, ...]) -> str:
    try:
        study = api.load(path, overrides)
        assert study.check_summary().strip()
    except StudyError as error:
        reported = [str(problem) for problem in error.problems]
        if not reported or any(not problem.what.strip() for problem in error.problems):
            raise AssertionError(f"refused without a word: {reported}") from error
        return "refused"
    try:
        assert str(study.plan()).strip()
    except TradestudyError as error:
        if not str(error).strip() or error.exit_status != 2:
            raise AssertionError(f"no plan, and no word of what is wrong with the input: {error}") from error
        return "no plan"
    return "planned"


def feed(
    tally: Tally,
    watch: Watch,
    path: Path,
    overrides: tuple[str, ...],
    source: str,
    outcome_of: Callable[[Path, tuple[str, ...]], str] = _outcome,
) -> None:
    """Check and plan one file, or do with it what else is asked, and judge how that ends."""
    tally.inputs += 1
    tally.by_source[source] += 1
    begin = time.monotonic()
    signal.setitimer(signal.ITIMER_PROF, LONGEST_SECONDS)
    signal.setitimer(signal.ITIMER_REAL, LONGEST_WAIT)
    try:
        with watch.watching() as seen:
            outcome = outcome_of(path, overrides)
    except HangError:
        tally.find(source, "hang", f"longer than {LONGEST_SECONDS:g} s of processor time or {LONGEST_WAIT:g} s")
    except MemoryError:
        tally.find(source, "memory", f"beyond {MOST_BYTES} bytes")
    except Exception as error:  # the very thing that is looked for
        tally.find(source, "traceback", f"{type(error).__name__}: {' '.join(str(error).split())[:300]}")
    else:
        tally.outcomes[outcome] += 1
        for what in seen:
            tally.find(source, "reaches out", what)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        tally.slowest = max(tally.slowest, time.monotonic() - begin)


def campaign(folder: Path, *, inputs: int, seed: int, keep: Callable[[Path, int], None]) -> Tally:
    """Feed so many inputs."""
    tally, watch, corpus = Tally(), Watch(), Corpus.shipped(folder)
    rng = random.Random(seed)

    def fed(text: bytes, overrides: tuple[str, ...], source: str) -> None:
        path = corpus.folder / "fuzzed.yaml"
        path.write_bytes(text)
        before = len(tally.findings)
        feed(tally, watch, path, overrides, source)
        if len(tally.findings) > before:
            keep(path, tally.inputs)

    with limits():
        invented = int(INVENTED_SHARE * inputs)
        invent(invented, seed, lambda text: fed(text, (), "invented"))
        while tally.inputs < inputs:
            text, overrides = mutated(corpus, rng)
            fed(text, overrides, "mutated")
    left = sorted(path.name for path in folder.rglob("*") if path.is_file() and path not in corpus.own_files())
    if left != ["fuzzed.yaml"]:
        tally.find("all", "file", f"left in the folder: {left}")
    return tally


@contextlib.contextmanager
def limits() -> Iterator[None]:
    """Ten seconds of processor time and one gigabyte more than now; warnings are errors."""

    def hang(*_: object) -> None:
        raise HangError

    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    before = {number: signal.signal(number, hang) for number in (signal.SIGALRM, signal.SIGPROF)}
    try:
        resource.setrlimit(resource.RLIMIT_AS, (used + MOST_BYTES, hard))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        for number, handler in before.items():
            signal.signal(number, handler)


def main() -> None:
    """Run the campaign and keep its figures."""
    parser = argparse.ArgumentParser(description="Feed bad study files to check and plan, in bulk.")
    parser.add_argument("--inputs", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    kept = Path(tempfile.mkdtemp(prefix="fuzz-findings-"))

    def keep(path: Path, number: int) -> None:
        shutil.copy(path, kept / f"{number}.yaml")

    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        tally = campaign(Path(folder), inputs=asked.inputs, seed=asked.seed, keep=keep)
    bad = {kind: tally.outcomes[kind] for kind in ("traceback", "hang", "memory", "reaches out", "file")}
    path = record.write(
        "fuzz",
        "Bad input in bulk: what was fed to `check` and `plan`, and how it ended",
        f"python -m tests.campaigns.fuzz --inputs {asked.inputs} --seed {asked.seed}",
        ("What", "Count"),
        [
            ("inputs", tally.inputs),
            *((f"of them {source}", count) for source, count in sorted(tally.by_source.items())),
            ("accepted and planned", tally.outcomes["planned"]),
            ("accepted, no plan for it, said why", tally.outcomes["no plan"]),
            ("refused in words", tally.outcomes["refused"]),
            ("tracebacks and warnings", bad["traceback"]),
            (f"hangs beyond {LONGEST_SECONDS:g} s", bad["hang"]),
            ("beyond 1 GB", bad["memory"]),
            ("writing, moving or starting anything", bad["reaches out"] + bad["file"]),
            ("slowest input [s]", f"{tally.slowest:.2f}"),
            ("peak memory of the process [MB]", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024),
            ("wall time [s]", f"{time.monotonic() - begin:.0f}"),
        ],
    )
    print(path.read_text(encoding="utf-8"))
    if tally.findings:
        print("\n".join(tally.findings[:50]), f"\ninputs kept in {kept}")
    else:
        kept.rmdir()
    sys.exit(1 if tally.findings else 0)


if __name__ == "__main__":
    main()
