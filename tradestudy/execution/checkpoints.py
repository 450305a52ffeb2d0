"""Finished points on disk, so that an interrupted run resumes where it stopped."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import io
import os
import pickle
import secrets
import struct
from collections.abc import Iterator, Sequence
from dataclasses import is_dataclass
from enum import Enum
from io import FileIO
from pathlib import Path
from typing import Any, Final

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
            found = getattr(importlib.import_module(module), name)
            if isinstance(found, type) and (is_dataclass(found) or issubclass(found, Enum)):
                return found
        raise pickle.UnpicklingError(f"{module}.{name} is not allowed in a result")
