"""Results on disk: complete files only, identical bytes for identical results, and errors for unreadable files."""

from __future__ import annotations

import contextlib
import hashlib
import io
import itertools
import json
import os
import platform
import re
import secrets
import shutil
from collections.abc import Hashable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from tradestudy.errors import NoResultsError, PlaceError, ResultsError
from tradestudy.results import FORMAT_VERSION, GROUPS, Variable
from tradestudy.wording import json_text, listed

if TYPE_CHECKING:
    import h5py
    import xarray as xr  # imported below where it is used: plans import this, too

RESULTS = "results.nc"
RUN = "run.json"
CHECKSUM = "results_sha256"
PICTURES = "pictures"
LIST = ".tradestudy"  # in a folder: the files that this program wrote there, a relative path on each line
_UNFINISHED: Final = ".unfinished"  # of `execution.Checkpoints`
_ALWAYS: Final = (RESULTS, RUN, "report.html", "report.pdf")
RUN_FILES: Final = (*_ALWAYS, "figures/*.svg", "tables/*.csv", "posteriors/*.nc", "matchers.yaml", "fitted/*.yaml")

_CF_UNITS: Final = {
    "px": "1", "m px": "m", "px/m": "1/m", "wave": "1", "electron": "count", "electrons": "count", "photon": "count",
    "DN/electron": "1", "mixed": "",
}  # fmt: skip
"""Units that UDUNITS does not know, and what ``results.nc`` has in their place: nothing where values have several."""
_OWN_UNITS: Final = "measured_in"
_NO_VARIABLE: Final = "This is a netCDF dimension but not a netCDF variable."
_OF_NETCDF: Final = {"CLASS", "NAME", "REFERENCE_LIST", "DIMENSION_LIST", "_Netcdf4Dimid", "_NCProperties"}

# Types of the values in run.json, and of the members of those that have some.
_KINDS: Final = {
    **dict.fromkeys(("study", "study_hash", "code_hash", "file", "started", CHECKSUM, PICTURES), str),
    "seed": int,
}
_MEMBERS: Final = {
    "inputs": (dict, str),
    "options": (list, str),
    "versions": (dict, str),
    "machine": (dict, str | int),
    "seconds": (dict, int | float),
    "points": (dict, dict),
}

_PART = re.compile(r"\..+\.[0-9a-f]{8}\.(?P<process>\d+)@(?P<machine>.+)\.part")


def refuse_foreign(directory: Path, patterns: Iterable[str]) -> None:
    """Refuse to write files over those that this program did not write; call it before anything is computed.

    In the folder of a run, patterns with ``*`` are skipped: other files may lie beside its figures and tables.

    Raises
    ------
    PlaceError
        If a file that matches is not the program's.
    """
    ours = written(directory)
    if any((directory / _UNFINISHED).glob("*.points")) or (RUN not in _listed(directory) and RUN in ours):
        return  # an interrupted call or an earlier version, which kept no list
    for pattern in patterns:
        if RUN in ours and "*" in pattern:
            continue
        for path in sorted(directory.glob(pattern)):
            if path.relative_to(directory).as_posix() not in ours:
                remedy = "move it away, or give another output folder"
                raise PlaceError(
                    "this file, which tradestudy did not write, is in the way", value=str(path), remedy=remedy
                )


def written(directory: Path) -> frozenset[str]:
    """The files in a folder that this program wrote there, as relative paths."""
    listed = _listed(directory)
    with contextlib.suppress(ResultsError):
        if RUN not in listed and "study_hash" in read_run(directory):
            return listed | {*_ALWAYS}
    return listed


def _listed(directory: Path) -> frozenset[str]:
    with contextlib.suppress(OSError, ValueError):
        return frozenset((directory / LIST).read_text(encoding="utf-8").splitlines())
    return frozenset()


def remove_earlier(directory: Path, ours: frozenset[str], patterns: Iterable[str], kept: Iterable[str] = ()) -> None:
    """Remove files of an earlier call that match and are the program's, ``ours``."""
    for path in [path for pattern in patterns for path in directory.glob(pattern)]:
        if path.relative_to(directory).as_posix() in ours - {*kept}:
            path.unlink(missing_ok=True)  # another call may have removed it first


def list_written(directory: Path, names: Iterable[str]) -> None:
    """Note files, as relative paths, that this program writes into a folder."""
    listed = _listed(directory)
    if new := [name for name in names if name not in listed]:
        directory.mkdir(parents=True, exist_ok=True)
        with (directory / LIST).open("a", encoding="utf-8") as file:
            file.write("".join(f"{name}\n" for name in new))


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; it replaces ``path`` only if the block succeeds."""
    temporary = _temporary(path)
    try:
        yield temporary
        _flush(temporary)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def _temporary(path: Path) -> Path:
    """An unused path beside ``path``, in a folder that exists; its name says which process writes it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    return beside(path)


def beside(path: Path) -> Path:
    """An unused path beside ``path``; its name says which process writes it."""
    return path.with_name(f".{path.name}.{secrets.token_hex(4)}.{os.getpid()}@{platform.node()}.part")


def _flush(path: Path) -> None:
    """Wait until the disk has a file, or a power failure could leave a truncated one under its final name."""
    with path.open("rb") as file:
        os.fsync(file.fileno())


def replace_file(path: Path, content: bytes) -> None:
    """Write a file so that a reader sees either the old content or the new; create missing folders.

    Raises
    ------
    OSError
        If it cannot be written; the old file is untouched and nothing is left behind.
    """
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def remove_abandoned(directory: Path) -> None:
    """Finish or remove what killed processes of this machine left half-written in a folder and its subfolders."""
    with _locked(directory):
        _place_results(directory)
    for part in (*directory.glob(".*.part"), *directory.glob("*/.*.part")):
        owner = _PART.fullmatch(part.name)
        if owner and owner["machine"] == platform.node() and not _is_running(int(owner["process"])):
            if part.is_dir():
                shutil.rmtree(part, ignore_errors=True)
            else:
                part.unlink(missing_ok=True)


def _is_running(process: int) -> bool:
    """Whether a process of this machine is alive; assumed alive where that cannot be checked safely."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # it exists, but belongs to another user
        return True
    return True


def encoded(tree: xr.DataTree) -> bytes:
    """The content of ``results.nc``: netCDF4, as ``tree.to_netcdf(engine="h5netcdf")`` writes it, 9 times faster.

    h5netcdf looks up the dimensions of every variable many times by their paths in the file.
    """
    import h5py

    content = io.BytesIO()  # in memory: HDF5 crashes the process when the disk is full
    numbers = itertools.count()
    with h5py.File(content, "w", track_order=True) as file:
        file.attrs["_NCProperties"] = np.bytes_(f"version=2,h5py={h5py.__version__}")
        for node in tree.subtree:
            group = file if node.path == "/" else file.create_group(node.path, track_order=True)
            _encode_group(group, node.to_dataset(inherit=False), numbers)
    return content.getvalue()


def _encode_group(group: h5py.Group, data: xr.Dataset, numbers: Iterator[int]) -> None:
    from xarray.conventions import cf_encoder

    variables, attributes = cf_encoder(dict(data.variables), data.attrs)
    _describe(group, attributes)
    scales: dict[Hashable, h5py.Dataset] = {}
    for dim, size in data.sizes.items():
        if dim in variables:
            label, scales[dim] = str(dim), _encode_variable(group, str(dim), variables.pop(dim))
        else:
            # netCDF4 stores a dimension without labels as such an empty array with this text.
            label = f"{_NO_VARIABLE}{size:10}"
            scales[dim] = group.create_dataset(str(dim), (size,), dtype=">f4")
        scales[dim].make_scale(label)
        scales[dim].attrs["_Netcdf4Dimid"] = np.int32(next(numbers))  # their order
    for name, variable in variables.items():
        stored = _encode_variable(group, str(name), variable)
        for axis, dim in enumerate(variable.dims):
            stored.dims[axis].attach_scale(scales[dim])


def _encode_variable(group: h5py.Group, name: str, variable: xr.Variable) -> h5py.Dataset:
    import h5py

    values, fill = np.asarray(variable.values), variable.attrs.get("_FillValue")
    if values.dtype.kind in "OU":
        values = values.astype(h5py.string_dtype())
    stored = group.create_dataset(name, data=values, fillvalue=fill, track_order=True)
    _describe(stored, _with_known_units(variable.attrs))
    return stored


def _with_known_units(attributes: Mapping[Hashable, Any]) -> dict[Hashable, Any]:
    """Attributes whose ``units`` UDUNITS knows, for programs that expect CF conventions; ours moves to `_OWN_UNITS`."""
    units = attributes.get("units")
    if units not in _CF_UNITS:
        return dict(attributes)
    cf_units = {"units": _CF_UNITS[units]} if _CF_UNITS[units] else {}
    return {key: value for key, value in attributes.items() if key != "units"} | cf_units | {_OWN_UNITS: units}


def _restore_units(tree: xr.DataTree) -> None:
    for node in tree.subtree:
        for variable in node.variables.values():
            if _OWN_UNITS in variable.attrs:
                variable.attrs["units"] = variable.attrs.pop(_OWN_UNITS)


def _describe(stored: h5py.Group | h5py.Dataset, attributes: Mapping[Hashable, Any]) -> None:
    for name, value in attributes.items():
        stored.attrs[str(name)] = value if isinstance(value, str) else np.atleast_1d(value)


def _described(stored: h5py.Group | h5py.Dataset) -> dict[str, Any]:
    """The attributes that `_describe` wrote."""
    attributes = {name: stored.attrs[name] for name in stored.attrs if name not in _OF_NETCDF}
    return {name: value[0] if np.shape(value) == (1,) else value for name, value in attributes.items()}


def write_finished(content: bytes, run: Mapping[str, Any], directory: Path, pictures: Path | None = None) -> None:
    """Replace ``results.nc`` and ``run.json`` together: at every moment, one whole run can be read.

    A folder of ``pictures`` `beside` that of an earlier run takes its place.

    The new results lie complete beside the old ones before ``run.json``, which names them by their checksum, is
    replaced. From then on they are the results, even if this process dies before it gives them their final name.
    """
    temporary = _temporary(directory / RESULTS)
    try:
        temporary.write_bytes(content)
        _flush(temporary)
        with _locked(directory):
            try:
                named = {} if pictures is None else {PICTURES: pictures.name}
                replace_file(directory / RUN, _text_of({**run, **named, CHECKSUM: _checksum(content)}).encode())
            finally:  # an interruption may come after the record was replaced
                _place_results(directory)
    finally:
        if not _is_named(temporary):
            temporary.unlink(missing_ok=True)


def _place_results(directory: Path) -> None:
    """Give the results and pictures that ``run.json`` names their final name, if they do not have it yet."""
    for part in directory.glob(f".{RESULTS}.*.part"):
        if _is_named(part):
            part.replace(directory / RESULTS)
    for part in directory.glob(f".{PICTURES}.*.part"):
        with contextlib.suppress(ResultsError):
            if read_run(directory).get(PICTURES) == part.name:
                _replace_folder(directory / PICTURES, part)


def _replace_folder(old: Path, new: Path) -> None:
    """Replace a folder, keeping the files in it that this program did not write; can be repeated after a death."""
    ours = written(old)
    for path in [path for path in old.rglob("*") if path.is_file()]:
        relative = path.relative_to(old)
        if relative.as_posix() not in ours and not (new / relative).exists():
            (new / relative).parent.mkdir(parents=True, exist_ok=True)
            path.replace(new / relative)
    if old.exists():
        shutil.rmtree(old)
    new.replace(old)


def _is_named(part: Path) -> bool:
    """Whether ``run.json`` names results that lie here only, without their final name."""
    try:
        named = read_run(part.parent).get(CHECKSUM)
    except ResultsError:  # no record
        return False
    return _checksum_of_file(part) == named != _checksum_of_file(part.with_name(RESULTS))


def _checksum_of_file(path: Path) -> str:
    """The checksum of a file, which may be too large to hold in memory twice; empty if there is none."""
    with contextlib.suppress(FileNotFoundError), path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
    return ""


def _named_results(directory: Path, record: Mapping[str, Any]) -> tuple[Path, bytes] | None:
    """The file with the results that a record names by their checksum, and its content; None if there is none."""
    path = directory / RESULTS
    # Twice the final name: another process may give it to the results meanwhile.
    for candidate in (path, *sorted(directory.glob(f".{RESULTS}.*.part")), path):
        with contextlib.suppress(FileNotFoundError):
            if _checksum(content := candidate.read_bytes()) == record.get(CHECKSUM):
                return candidate, content
    return None


@contextlib.contextmanager
def _locked(directory: Path) -> Iterator[None]:
    """Let no other run replace results in a folder meanwhile, where the system can lock folders."""
    if os.name != "posix" or not directory.is_dir():
        yield
        return
    import fcntl

    folder = os.open(directory, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):  # some network file systems cannot lock
            fcntl.flock(folder, fcntl.LOCK_EX)
        yield
    finally:
        os.close(folder)


def read_back(run: Mapping[str, Any]) -> dict[str, Any]:
    """A record as ``run.json`` returns it, so that reports made now and later from the files are identical."""
    record: dict[str, Any] = json.loads(_text_of(run))
    return record


def read_finished(directory: Path) -> tuple[xr.DataTree, dict[str, Any]]:
    """Read ``results.nc`` into memory, and ``run.json``.

    Raises
    ------
    ResultsError
        If a file is missing, damaged, incomplete or of another format version, or if they belong to different runs.
    """
    path = directory / RESULTS
    if not path.is_file() and not (directory / RUN).is_file():
        raise NoResultsError("no results here", value=str(path), remedy="run the study first")
    record = read_run(directory)
    try:
        named = _named_results(directory, record)
    except OSError as error:
        raise _unreadable(path, error) from error
    if named is None and not path.is_file():
        raise NoResultsError("no results here", value=str(path), remedy="run the study first")
    if named is None:  # checked before HDF5 reads the bytes: what it does with damaged ones is undefined
        raise ResultsError(
            "the results are damaged or belong to another run than their record: the checksum differs",
            value=str(path),
            remedy="run the study again",
        )
    if lacking := [key for key in (*_KINDS, *_MEMBERS) if key != PICTURES and key not in record]:
        message = f"the run's record lacks {listed(lacking)}"
        raise ResultsError(message, value=str(directory / RUN), remedy="run the study again")
    return _tree_of(named[1], path), record


def _text_of(run: Mapping[str, Any]) -> str:
    return json_text(run) + "\n"


def _checksum(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _unreadable(path: Path, error: Exception) -> ResultsError:
    return ResultsError("the results file cannot be read", value=f"{path}: {error}", remedy="run the study again")


def _tree_of(content: bytes, path: Path) -> xr.DataTree:
    """The tree in the bytes of a results file; ``path`` names it in errors."""
    import xarray as xr

    try:
        tree = xr.DataTree.from_dict(decoded(content))
    except (OSError, ValueError, KeyError, RuntimeError) as error:
        raise _unreadable(path, error) from error
    version = tree.attrs.get("format_version")
    if version != FORMAT_VERSION:
        raise ResultsError(
            "the results file has another format version",
            value=f"{version} in {path}",
            limit=str(FORMAT_VERSION),
            remedy="run the study again",
        )
    for group in GROUPS.keys() & tree.children.keys():
        for name, stored in tree[group].to_dataset().data_vars.items():
            if name in GROUPS[group] and (wrong := _difference(stored, GROUPS[group][str(name)])):
                message = (
                    f"the results file is damaged or from another version of the program: /{group}/{name} has {wrong}"
                )
                raise ResultsError(message, value=str(path), remedy="run the study again")
    _restore_units(tree)
    return tree


def decoded(content: bytes) -> dict[str, xr.Dataset]:
    """The groups that `encoded` wrote, as ``xr.open_groups(engine="h5netcdf")`` reads them, 5 times faster."""
    import h5py

    with h5py.File(io.BytesIO(content), "r") as file:
        return {group.name: _decoded_group(group) for group in _groups(file)}


def _groups(group: h5py.Group) -> Iterator[h5py.Group]:
    """A group and those in it, in the order of their making."""
    import h5py

    yield group
    for inner in group.values():
        if isinstance(inner, h5py.Group):
            yield from _groups(inner)


def _decoded_group(group: h5py.Group) -> xr.Dataset:
    import h5py
    import xarray as xr

    stored = {name: item for name, item in group.items() if isinstance(item, h5py.Dataset)}
    # Variables refer to their labels by address in the file, not by name.
    addresses = {h5py.h5o.get_info(dataset.id).addr: name for name, dataset in stored.items() if dataset.is_scale}
    variables: dict[str, Any] = {}
    for name, dataset in sorted(stored.items(), key=lambda entry: entry[1].is_scale):  # labels last
        if dataset.attrs.get("NAME", b"").startswith(_NO_VARIABLE.encode()):
            continue
        scales = () if dataset.is_scale else (axis[0] for axis in dataset.dims)
        dims = [addresses[h5py.h5o.get_info(scale.id).addr] for scale in scales] or [name] * dataset.is_scale
        values = dataset[()]
        if h5py.check_string_dtype(dataset.dtype):
            values = np.array(np.asarray(dataset.asstr()[()]).tolist(), dtype=str).reshape(dataset.shape)
        variables[name] = (dims, values, _described(dataset))
    return xr.decode_cf(xr.Dataset(variables, attrs=_described(group)))


def _difference(stored: xr.DataArray, declared: Variable) -> str:
    """How a variable differs from its declaration, in words; empty if it does not."""
    dims = [str(dim) for dim in stored.dims]
    swept = max(len(dims) - len(declared.dims), 0)
    if tuple(dims[swept:]) != declared.dims or not all("path" in stored[dim].attrs for dim in dims[:swept]):
        return f"the dimensions ({', '.join(dims)}), not ({', '.join(declared.dims)})"
    if "distance" in dims and "distance" not in stored.coords:
        return "no distances"
    is_text = stored.dtype.kind in "OU"
    if stored.size and is_text != (declared.units == ""):  # no text is stored as no numbers
        return "text in place of numbers" if is_text else "numbers in place of text"
    return ""


def read_run(directory: Path) -> dict[str, Any]:
    """Read ``run.json``.

    Raises
    ------
    ResultsError
        If it is missing or damaged.
    """
    path = directory / RUN
    try:
        run = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ResultsError(
            "the run's record cannot be read", value=f"{path}: {error}", remedy="run the study again"
        ) from error
    if not isinstance(run, dict):
        raise ResultsError("the run's record is not a mapping", value=str(path), remedy="run the study again")
    for key, value in run.items():
        if not _is_valid(key, value):
            message = f"the run's record has an impossible value of '{key}'"
            raise ResultsError(message, value=str(path), remedy="run the study again")
    return run


def _is_valid(key: str, value: object) -> bool:
    """Whether a value of ``run.json`` has the type that a run writes."""
    if key in _MEMBERS:
        outer, inner = _MEMBERS[key]
        members = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
        # Python's parser of JSON accepts NaN, the only member that does not equal itself.
        return isinstance(value, outer) and all(isinstance(member, inner) and member == member for member in members)
    return isinstance(value, _KINDS.get(key, object))
