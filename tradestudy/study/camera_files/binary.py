"""Binary calibration files, npz of NumPy and mat of MATLAB, as the trees of text files. Pickles are never loaded."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from tradestudy.study.camera_files import mat_files
from tradestudy.study.camera_files.located import CameraFile, CameraFileError
from tradestudy.study.document import Entry, ListEntry, MappingEntry, Member, Place, ScalarEntry, scalar_text
from tradestudy.study.source import DEEPEST

NPZ, MAT, HDF5, PICKLE = b"PK\x03\x04", b"MATLAB 5.0 MAT-file", b"\x89HDF", b"\x80"
MAGIC: Final = (NPZ, MAT, b"MATLAB 7.3", HDF5, PICKLE)
"""The first bytes of binary files that `parsed` reads or refuses by name."""
_MOST_BYTES: Final = 64_000_000  # unpacked
_MOST_SHOWN: Final = 1000
"""Numbers of the largest array that becomes a list; larger ones, such as corners, are no part of a camera."""
_TO_STRUCT: Final = "in MATLAB, run s = toStruct(stereoParams); save('stereo.mat', 's', '-v7'), and give this file"


def parsed(path: Path, content: bytes, label: str) -> CameraFile:
    """A binary file with its tree.

    Raises
    ------
    CameraFileError
        The file is a pickle, contains objects, or is broken.
    """
    place = Place(str(path), 1, 1)
    if content.startswith(PICKLE):
        raise CameraFileError(
            place.problem(
                (), "a pickle can run code and is never loaded; save the matrices by np.savez(file, K1=K1, …)"
            )
        )
    if not content.startswith((NPZ, MAT)):
        raise CameraFileError(place.problem((), f"a .mat file of version 7.3 is not read; {_TO_STRUCT}"))
    syntax = "npz" if content.startswith(NPZ) else "mat"
    try:
        values = _npz(content) if syntax == "npz" else _mat(content)
        root = _entry(values, place, 0)
    except CameraFileError:
        raise
    except _ObjectsError as error:
        raise CameraFileError(place.problem((), str(error))) from None
    except Exception as error:  # of any class: readers of binary files do not check what they read
        what = f"this {syntax} file cannot be read: {str(error)[:80] or type(error).__name__}; save it again"
        raise CameraFileError(place.problem((), what)) from None
    return CameraFile(path=path, label=label, syntax=syntax, text="", root=root)


class _ObjectsError(Exception):
    """The file contains objects, or too much."""


def _npz(content: bytes) -> Mapping[str, Any]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if sum(member.file_size for member in archive.infolist()) > _MOST_BYTES:
            raise _ObjectsError(f"the file contains more than {_MOST_BYTES // 1_000_000} MB; save the matrices alone")
    with np.load(io.BytesIO(content), allow_pickle=False) as arrays:
        try:
            return {name: arrays[name] for name in arrays.files}
        except ValueError as error:
            if "pickle" not in str(error):
                raise
            what = "an array of objects is a pickle, which can run code and is never loaded; save arrays of numbers"
            raise _ObjectsError(what) from None


def _mat(content: bytes) -> Mapping[str, Any]:
    try:
        return mat_files.read(content, _MOST_BYTES)
    except mat_files.UnreadArrayError as error:
        what = f"the file contains {error}, which only MATLAB can read; {_TO_STRUCT}"
        raise _ObjectsError(what) from None


def _entry(value: Any, place: Place, depth: int) -> Entry:
    if depth > DEEPEST:
        raise _ObjectsError(f"values are nested more than {DEEPEST} levels deep")
    if isinstance(value, dict):
        members = {str(key): Member(place, _entry(item, place, depth + 1)) for key, item in value.items()}
        return MappingEntry(place=place, members=members)
    value = value.tolist() if isinstance(value, np.ndarray | np.generic) and np.size(value) <= _MOST_SHOWN else value
    if isinstance(value, list):
        return ListEntry(place=place, items=tuple(_entry(item, place, depth + 1) for item in value))
    if not isinstance(value, str | int | float | bool):
        return ScalarEntry(place=place, value=None if value is None else "", text=f"{type(value).__name__}")
    return ScalarEntry(place=place, value=value, text=scalar_text(value))
