"""Long steps of a study, made of independent points: resumed, spread over workers, saved and timed."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import io
import logging
import os
import pickle
import platform
import secrets
import struct
import time
from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, fields, is_dataclass
from enum import Enum
from functools import cache, partial
from importlib.metadata import version
from io import FileIO
from pathlib import Path, PurePath
from types import FunctionType, MethodType
from typing import Any, Final, get_origin, get_type_hints

import numpy as np

from tradestudy.errors import TradestudyError, UnaffordableError
from tradestudy.execution.executor import Executor, LostPointError, Point, Raised, Serial, Value, heard_by
from tradestudy.provenance import code_hash

_LOG: Final = logging.getLogger(__name__)  # tells what is taken from an interrupted run
FOLDER: Final = ".unfinished"
_SUFFIX: Final = ".points"
_MARK: Final = bytes.fromhex("8f7470 6f696e74 0a")  # starts every record; no text starts with these bytes
_HEAD: Final = struct.Struct(f"<{len(_MARK)}s32sQ32s")  # mark, key, length of the content, checksum
# Types of numpy and Python that a value on disk may contain, besides this package's dataclasses.
_NUMPY: Final = frozenset({"_reconstruct", "_frombuffer", "scalar", "ndarray", "dtype"})
_BUILTINS: Final = frozenset({"complex", "set", "frozenset", "slice", "range"})


class Checkpoints:
    """Values of finished points, in a hidden folder inside the output folder.

    Each run appends to its own file a record for every finished point: key, length, SHA-256, value. Incomplete records
    and those whose checksum does not match are ignored. A run only reads the files of other runs; when it finishes, it
    removes those that no running process has locked.

    Parameters
    ----------
    directory
        The output folder; nothing is created in it before a point is finished.
    fresh
        Whether to remove the points of earlier runs instead of reading them.
    """

    def __init__(self, directory: Path, *, fresh: bool = False) -> None:
        self._folder = directory / FOLDER
        self._own: FileIO | None = None
        self._read: list[FileIO] = []
        self._index: dict[bytes, tuple[FileIO, int, int]] = {}
        if fresh:
            self.remove()
        else:
            self._index_all()

    def finished(self, keys: Sequence[bytes]) -> dict[int, Any]:
        """Values of the keys that are on disk, by their position among the keys."""
        values = {}
        for place, key in enumerate(keys):
            if key in self._index:
                file, start, length = self._index[key]
                file.seek(start)
                with contextlib.suppress(Exception):  # whatever is not a record that a run wrote is computed again
                    values[place] = _Unpickler(io.BytesIO(file.read(length))).load()
        return values

    def add(self, key: bytes, value: object) -> None:
        """Write a value to disk at once."""
        content = pickle.dumps(value, protocol=pickle.HIGHEST_PROTOCOL)
        if self._own is None:
            self._own = self._begin()
        head = _HEAD.pack(_MARK, key, len(content), _checksum(key, content))
        rest = memoryview(head + content)
        while rest:  # an almost full disk may accept only part of the record
            rest = rest[self._own.write(rest) :]

    def close(self) -> None:
        """Close the files; finished points stay on disk."""
        for file in (*self._read, *(() if self._own is None else (self._own,))):
            file.close()
        self._own, self._read, self._index = None, [], {}

    def remove(self) -> None:
        """Remove the folder, except files to which other running processes write."""
        self.close()
        for path in self._folder.glob(f"*{_SUFFIX}"):
            with contextlib.suppress(OSError), path.open("rb", buffering=0) as file:
                if _held(file):
                    path.unlink()
        with contextlib.suppress(OSError):  # the folder is missing, or contains a file of another running process
            self._folder.rmdir()

    def _begin(self) -> FileIO:
        """Create a file of this run alone, locked against removal."""
        while True:
            self._folder.mkdir(parents=True, exist_ok=True)
            with contextlib.suppress(
                FileNotFoundError
            ):  # another run may have finished just now and removed the folder
                file = FileIO(self._folder / f"{secrets.token_hex(8)}{_SUFFIX}", "xb")
                _held(file)
                if os.fstat(file.fileno()).st_nlink:  # no other run removed it before it was locked
                    return file
                file.close()

    def _index_all(self) -> None:
        for path in sorted(self._folder.glob(f"*{_SUFFIX}")):
            with contextlib.suppress(FileNotFoundError):
                file = FileIO(path, "rb")
                self._read.append(file)  # kept open: another run may remove its name
                for key, start, length in _whole_records(file.readall()):
                    self._index[key] = file, start, length


def _whole_records(content: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Key, start and length of the content of every record whose checksum matches."""
    place = content.find(_MARK)
    while 0 <= place <= len(content) - _HEAD.size:
        _, key, length, checksum = _HEAD.unpack_from(content, place)
        start = place + _HEAD.size
        if start + length <= len(content) and _checksum(key, content[start : start + length]) == checksum:
            yield key, start, length
            place = content.find(_MARK, start + length)
        else:  # the record is damaged, so its length cannot be trusted
            place = content.find(_MARK, place + 1)


def _checksum(key: bytes, content: bytes) -> bytes:
    return hashlib.sha256(key + content).digest()


def _held(file: FileIO) -> bool:
    """Lock a file for as long as it is open; False if another run holds the lock."""
    if os.name != "posix":
        return True  # there, open files cannot be removed anyway
    import fcntl

    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


class _Unpickler(pickle.Unpickler):
    """Loads only this package's dataclasses, numpy arrays and plain values, because anyone may have written the folder.

    Anything else raises `pickle.UnpicklingError`.
    """

    def find_class(self, module: str, name: str) -> Any:
        if module == "builtins" and name in _BUILTINS:
            return super().find_class(module, name)
        if module.split(".")[0] == "numpy" and name in _NUMPY:
            return super().find_class(module, name)
        if module.split(".")[0] == "tradestudy" and "." not in name:
            loaded = getattr(importlib.import_module(module), name)
            if isinstance(loaded, type) and (is_dataclass(loaded) or issubclass(loaded, Enum)):
                return loaded
        raise pickle.UnpicklingError(f"{module}.{name} is not allowed in a result")


_COMPUTING = ("numpy", "scipy", "finufft", "emcee", "arviz-stats")


def fingerprint(*values: object) -> bytes:
    """SHA-256 of numbers, strings, arrays, ordered mappings, lists, dataclasses, module-level functions and classes.

    Pickles are unsuitable: their bytes depend on object identities and on the order of sets.

    Raises
    ------
    TypeError
        For any other value, since different values must never share a hash.
    """
    parts: list[bytes] = []
    _tell(values, parts)
    return hashlib.sha256(b"".join(parts)).digest()


def _tell(value: Any, parts: list[bytes]) -> None:
    kind = type(value)
    if value is None or kind in (bool, int, float):
        parts.append(f"{kind.__name__} {value!r};".encode())
    elif kind in (str, bytes):
        content = value.encode() if kind is str else value
        parts += (f"{kind.__name__} {len(content)}:".encode(), content)
    elif kind in (tuple, list):
        parts.append(f"{kind.__name__} {len(value)}:".encode())
        for item in value:
            _tell(item, parts)
    elif isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
        parts += (f"{value.dtype.str} {value.shape}:".encode(), value.tobytes())
    elif isinstance(value, Enum):
        parts.append(f"{_name(kind)}.{value.name};".encode())
    elif isinstance(value, Mapping):
        parts.append(f"mapping {len(value)}:".encode())
        for item in value.items():
            _tell(item, parts)
    elif isinstance(value, FunctionType | type) and "<" not in value.__qualname__:
        parts.append(f"{_name(value)};".encode())
    elif isinstance(value, PurePath):
        _tell(("path", str(value)), parts)
    else:
        inside = _inside(value)
        if inside is None:
            raise TypeError(f"{_name(kind)} has no fingerprint")
        parts.append(f"{_name(kind)} {len(inside)}:".encode())
        for item in inside:
            _tell(item, parts)


def _inside(value: Any) -> list[Any] | None:
    """The parts of an object; None if they are unknown."""
    names = _fields_of(value.__class__)
    if names is not None:
        return [getattr(value, name) for name in names]
    if isinstance(value, partial):
        return [value.func, value.args, value.keywords]
    if isinstance(value, MethodType):
        return [value.__self__, value.__func__]
    return None


@cache
def _fields_of(kind: type) -> tuple[str, ...] | None:
    if is_dataclass(kind):
        return tuple(member.name for member in fields(kind))
    if hasattr(kind, "model_fields"):  # parts of a study file
        return tuple(kind.model_fields)
    return None


def _name(definition: type | FunctionType) -> str:
    return f"{definition.__module__}.{definition.__qualname__}"


@cache
def environment() -> dict[str, str]:
    """Hash of this package's sources, and the versions of Python and of the libraries that compute numbers."""
    return {
        "tradestudy": code_hash(),
        "python": platform.python_version(),
        **{name: version(name) for name in _COMPUTING},
    }


_GOLDEN: Final = (5.0**0.5 - 1.0) / 2.0

# Called with the name of a step and the fraction of it that is done, from 0 to 1.
Progress = Callable[[str, float], None]

# Wall time [s] by name of the task; for run.json, never for results, which must be equal for equal runs.
Seconds = MutableMapping[str, float]


@contextmanager
def timed(seconds: Seconds, name: str) -> Iterator[None]:
    """Add the wall time of a block under this name."""
    begin = time.perf_counter()
    yield
    seconds[name] = seconds.get(name, 0.0) + time.perf_counter() - begin


def within_time(progress: Progress, limit: float, remedy: str, begun: float) -> Progress:
    """Progress that ends work begun at a monotonic time when it reports later than ``limit`` [s] after it."""

    def report(step: str, share: float) -> None:
        if time.monotonic() > begun + limit:
            raise UnaffordableError(
                "the run has reached its time limit",
                value=f"{share:.0%} of the step '{step}'",
                limit=f"{limit:.3g} s",
                remedy=f"finished parts are kept, and the next run resumes: {remedy}",
            )
        progress(step, share)

    return report


def mixed(count: int) -> list[int]:
    """An order of ``count`` points in which any first fraction of them takes about that fraction of the time.

    Neighbouring points often take equally long, so the golden ratio spreads the first ones evenly among all.
    """
    return sorted(range(count), key=lambda k: k * _GOLDEN % 1.0)


def _could_return(function: Callable[..., Any], value: object) -> bool:
    """Whether a value has the type that a function declares to return, with all its fields if it is a dataclass."""
    try:
        declared = get_type_hints(function).get("return", object)
        kind = get_origin(declared) or declared
        fits = isinstance(value, (int, kind) if kind is float else kind)
    except (NameError, TypeError):  # imported for the type checker only, no plain function, or no class
        fits = True
    return fits and (not is_dataclass(value) or all(hasattr(value, member.name) for member in fields(value)))


class DeadlyPointError(TradestudyError):
    """Workers died repeatedly over one point of the study."""


@dataclass(frozen=True, kw_only=True)
class Steps:
    """How the independent points of a study are computed.

    Parameters
    ----------
    executor
        Computes the points.
    checkpoints
        Saves and finds finished points; None: nothing is saved.
    progress
        Called with the name of a step and the fraction of it that is done.
    counts
        Records, for each step, how many points were computed and how many were taken from an earlier run.
    """

    executor: Executor = field(default_factory=Serial)
    checkpoints: Checkpoints | None = None
    progress: Progress = lambda _step, _share: None
    counts: dict[str, dict[str, int]] = field(default_factory=dict)

    def map(
        self,
        step: str,
        function: Callable[[Point], Value],
        points: Sequence[Point],
        labels: Sequence[str],
    ) -> list[Value]:
        """Values of a function at points, in the order of the points, but computed in a `mixed` order.

        Parameters
        ----------
        step
            Name of the step, for the progress shown and for run.json.
        function
            A module-level function whose value at a point depends on the point alone.
        points
            Its arguments; their content and the code make up the key under which a value is saved.
        labels
            Readable names of the points.

        Raises
        ------
        DeadlyPointError
            Workers died repeatedly over one point; the error contains its label.
        Exception
            The error of the first point that fails; all points before it are finished then.
        """
        values: dict[int, Any] = {}
        keys: list[bytes] = []
        if self.checkpoints is not None:
            shared = fingerprint(environment(), function)
            keys = [fingerprint(shared, point) for point in points]
            found_before = self.checkpoints.finished(keys)
            values = {i: value for i, value in found_before.items() if _could_return(function, value)}
        taken = len(values)
        missing = [i for i in mixed(len(points)) if i not in values]
        executor = self.executor if len(missing) > 1 else Serial()  # a single point needs no workers
        failed: dict[int, Exception] = {}
        furthest = 0.0

        def report(share_of_next: float = 0.0) -> None:
            nonlocal furthest
            done = len(values) + share_of_next
            furthest = max(furthest, done / max(1, len(points)))  # a point may repeat a part of its work
            self.progress(step, furthest)

        report()
        if taken:
            _LOG.info("%s: %d of %d parts taken from an interrupted run", step, taken, len(points))
        try:
            with (
                heard_by(report),  # computed in this thread, if at all: one point after another
                closing(executor.map_unordered(function, [points[i] for i in missing])) as outcomes,
            ):
                for number, outcome in outcomes:
                    place = missing[number]
                    if isinstance(outcome, Raised):
                        failed[place] = outcome.error
                    else:
                        values[place] = outcome
                        if self.checkpoints is not None:
                            self.checkpoints.add(keys[place], outcome)
                        report()
                    # Of several errors, that of the first point is raised, whatever the order of computation.
                    if failed and all(i in values for i in missing if i < min(failed)):
                        raise failed[min(failed)]
        except LostPointError as lost:
            raise DeadlyPointError(
                f"{lost.deaths} workers died one after another over the same point of the step '{step}'",
                value=labels[missing[lost.index]],
                remedy="finished points are kept; find out what ends the workers, such as too little memory",
            ) from lost
        finally:
            before = self.counts.get(step, {"computed": 0, "taken up": 0})  # a step may be computed in several calls
            added = {"computed": len(values) - taken, "taken up": taken}
            self.counts[step] = {name: before[name] + added[name] for name in added}
        return [values[i] for i in range(len(points))]
