"""Results on disk: deaths, interruptions and other runs never leave a folder without a whole run."""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tradestudy import results, units
from tradestudy.errors import NoResultsError, ResultsError
from tradestudy.results import FORMAT_VERSION, GROUPS, dataset, storage

COMPLETE = {
    **dict.fromkeys(("study", "study_hash", "code_hash", "file", "started"), ""),
    "seed": 0,
    **{key: {} for key in ("inputs", "versions", "machine", "seconds", "points")},
    "options": [],
}
"""A record with all keys that every run writes."""


def _tree(says: str) -> xr.DataTree:
    return xr.DataTree(xr.Dataset(attrs={"format_version": FORMAT_VERSION, "study": says}))


def _write(says: str, folder: Path) -> None:
    storage.write_finished(storage.encoded(_tree(says)), {**COMPLETE, "study": says}, folder)


def _read(folder: Path) -> str:
    """Which run a folder holds; its results and its record agree."""
    tree, record = storage.read_finished(folder)
    assert tree.attrs["study"] == record["study"]
    return str(record["study"])


def _parts(folder: Path) -> list[Path]:
    return list(folder.glob(".*.part"))


@pytest.mark.parametrize("reader", ["xarray", "ours"])
def test_the_file_reads_like_one_that_xarray_writes(reader: str) -> None:
    data = {
        "empty": (("none", "place"), np.zeros((0, 2))),
        "no_text": ("none", np.array([], dtype=str)),
        "text": ("place", ["ä", ""]),
        "words": (("place", "name"), np.array([["one", "two"], ["", "four"]], dtype=object)),
        "number": ((), 1.5, {"units": "m", "declared": 2, "values": [1.0, 2.0]}),
        "counts": ("place", np.array([1, 2], dtype=np.int8)),
        "flags": ("place", [True, False]),
        "unknown": ("place", [np.nan, np.inf]),
    }
    groups = {
        "/": xr.Dataset(attrs={"study": "ä", "format_version": 8, "wavelength": 5.5e-7}),
        "/first": xr.Dataset(data, {"place": [1.0, 2.0], "name": ["p", "q"]}, {"says": "attributes"}),
        "/second": xr.Dataset({"other": ("place", [1, 2])}),
    }
    tree = xr.DataTree.from_dict(groups)
    content = storage.encoded(tree)
    assert content == storage.encoded(tree)
    own, theirs = (
        {name: one.load() for name, one in xr.open_groups(io.BytesIO(file), engine="h5netcdf").items()}
        for file in (content, bytes(tree.to_netcdf(engine="h5netcdf")))
    )
    ours = own if reader == "xarray" else storage.decoded(content)
    assert list(ours) == list(theirs)
    for name, group in ours.items():
        xr.testing.assert_identical(group, theirs[name])
        assert list(group.data_vars) == list(theirs[name].data_vars)
        stored = [(one.dtype, one.encoding.get("dtype")) for one in group.variables.values() if one.size]
        assert stored == [
            (theirs[name][v].dtype, theirs[name][v].encoding.get("dtype")) for v in group.variables if group[v].size
        ]


# Writes another run over a finished one, once for every rename, and dies there, before or after it.
_DIE = """
import os, sys
from pathlib import Path
from tests.test_stored_results import _write

deaths = 0
for number in range(10):
    for dies_after in (False, True):
        folder = Path(sys.argv[1]) / f"{number}-{dies_after}"
        if sys.argv[2] == "over":
            _write("old", folder)
        child = os.fork()
        if child == 0:
            renames, replace = 0, os.replace
            def fatal(*paths, **more):
                global renames
                if renames == number and not dies_after:
                    os._exit(9)
                replace(*paths, **more)
                if renames == number:
                    os._exit(9)
                renames += 1
            os.replace = fatal
            _write("new", folder)
            os._exit(0)
        if os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0:
            sys.exit()
"""


@pytest.mark.parametrize("over", ["over", "empty"])
def test_a_death_at_any_rename_leaves_one_whole_run(over: str, tmp_path: Path) -> None:
    subprocess.run([sys.executable, "-c", _DIE, str(tmp_path), over], check=True, cwd=Path(__file__).parents[1])
    folders = sorted(tmp_path.iterdir())
    assert len(folders) == 5  # before and after each of two renames, and one undisturbed
    found = []
    for folder in folders:
        try:
            found.append(_read(folder))
        except NoResultsError:
            found.append("none")
        storage.remove_abandoned(folder)
        assert not _parts(folder)
        if found[-1] != "none":
            assert _read(folder) == found[-1]
        _write("third", folder)
        assert _read(folder) == "third"
        assert not _parts(folder)
    assert found == ["old" if over == "over" else "none", "new", "new", "new", "new"]


@pytest.mark.parametrize("number", [0, 1])
@pytest.mark.parametrize("says", ["old", "new"])
def test_an_interruption_at_any_rename_leaves_one_whole_run(
    number: int, says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _write("old", tmp_path)
    replace, renames = os.replace, 0

    def interrupted(source: Path, target: Path) -> None:
        nonlocal renames
        replace(source, target)
        renames += 1
        if renames == number + 1:
            raise KeyboardInterrupt

    monkeypatch.setattr(os, "replace", interrupted)
    if says == "old" and number == 1:  # the same results need no second rename
        _write(says, tmp_path)
    else:
        with pytest.raises(KeyboardInterrupt):
            _write(says, tmp_path)
    assert _read(tmp_path) == says
    assert not _parts(tmp_path)


def test_a_full_disk_keeps_the_old_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _write("old", tmp_path)
    for number in range(2):
        flushed = 0

        def full(_: int, last: int = number) -> None:
            nonlocal flushed
            if flushed == last:
                raise OSError(28, "No space left on device")
            flushed += 1

        monkeypatch.setattr(os, "fsync", full)
        with pytest.raises(OSError, match="No space"):
            _write("new", tmp_path)
        assert _read(tmp_path) == "old"
        assert not _parts(tmp_path)


def test_two_runs_that_end_at_once_leave_one_whole_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The second run begins to replace the record when the first has just replaced it."""
    script = "import sys; from pathlib import Path; from tests.test_stored_results import _write; "
    script += "print('begins', flush=True); _write('second', Path(sys.argv[1]))"
    replace_file: Callable[[Path, bytes], None] = storage.replace_file
    others: list[subprocess.Popen[str]] = []

    def with_another(path: Path, content: bytes) -> None:
        replace_file(path, content)
        command = [sys.executable, "-c", script, str(tmp_path)]
        others.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[1]))
        assert others[0].stdout is not None
        assert others[0].stdout.readline() == "begins\n"

    monkeypatch.setattr(storage, "replace_file", with_another)
    _write("first", tmp_path)
    with others[0] as other:
        assert other.wait() == 0
    assert _read(tmp_path) == "second"
    assert not _parts(tmp_path)


@pytest.mark.parametrize("key", sorted(COMPLETE))
def test_a_record_that_lacks_a_key_is_refused(key: str, tmp_path: Path) -> None:
    record = {name: value for name, value in COMPLETE.items() if name != key}
    storage.write_finished(storage.encoded(_tree("incomplete")), record, tmp_path)
    with pytest.raises(ResultsError) as refused:
        storage.read_finished(tmp_path)
    assert str(refused.value) == f"the run's record lacks {key}: {tmp_path / 'run.json'}; run the study again"


@pytest.mark.parametrize(
    ("dims", "values", "wrong"),
    [
        (("camera",), [0.1], "the dimensions (camera), not (camera, distance)"),
        (("distance", "camera"), [[0.1]], "the dimensions (distance, camera), not (camera, distance)"),
        (
            ("other", "camera", "distance"),
            [[[0.1]]],
            "the dimensions (other, camera, distance), not (camera, distance)",
        ),
        (("camera", "distance"), np.array([["0.1"]], dtype=object), "text in place of numbers"),
        (("camera", "distance"), [[0.1]], "no distances"),
        (("baseline", "camera", "distance"), [[[0.1]]], ""),
    ],
)
def test_variables_that_are_not_as_declared_are_refused(
    dims: tuple[str, ...], values: object, wrong: str, tmp_path: Path
) -> None:
    group = xr.Dataset(
        {"depth_uncertainty": (dims, values)}, coords={"baseline": ("baseline", [0.1], {"path": "rig.baseline"})}
    )
    if wrong != "no distances":
        group = group.assign_coords(distance=[1.0])
    tree = xr.DataTree.from_dict({"/": _tree("wrong").to_dataset(), "/depth": group})
    storage.write_finished(storage.encoded(tree), COMPLETE, tmp_path)
    if not wrong:
        storage.read_finished(tmp_path)
        return
    with pytest.raises(ResultsError) as refused:
        storage.read_finished(tmp_path)
    assert str(refused.value) == (
        "the results file is damaged or from another version of the program: /depth/depth_uncertainty has "
        f"{wrong}: {tmp_path / 'results.nc'}; run the study again"
    )


def test_results_of_an_earlier_format_are_refused_by_their_number(tmp_path: Path) -> None:
    tree = xr.DataTree(xr.Dataset(attrs={"format_version": FORMAT_VERSION - 1, "study": "old"}))
    storage.write_finished(storage.encoded(tree), COMPLETE, tmp_path)
    with pytest.raises(ResultsError, match=r"another format version.*run the study again") as refused:
        storage.read_finished(tmp_path)
    assert f"{FORMAT_VERSION - 1} in " in str(refused.value.value)
    assert refused.value.limit == str(FORMAT_VERSION)


def test_numbers_in_place_of_text_are_refused(tmp_path: Path) -> None:
    group = dataset("cameras", {"title": [1.0]}, {"camera": ["rig"]})
    tree = xr.DataTree.from_dict({"/": _tree("wrong").to_dataset(), "/cameras": group})
    storage.write_finished(storage.encoded(tree), COMPLETE, tmp_path)
    with pytest.raises(ResultsError, match="/cameras/title has numbers in place of text"):
        storage.read_finished(tmp_path)


def test_the_file_has_units_that_udunits_knows_and_reading_restores_ours(tmp_path: Path) -> None:
    """`cf_units.Unit` accepts these; it refuses px, electrons and mixed."""
    known = {"", "1", "1/K", "1/m", "K", "Pa", "W", "bit", "count", "kg", "m", "m²", "percent", "rad", "s", "sr"}
    ours = {one.units for group in GROUPS.values() for one in group.values()}
    ours |= {one.unit for one in vars(units).values() if isinstance(one, units.Dimension)} | {"wave"}
    data = {f"v{k}": ((), 1.0, {"units": unit, "long_name": unit}) for k, unit in enumerate(sorted(ours))}
    tree = xr.DataTree.from_dict({"/": _tree("right").to_dataset(), "/new": xr.Dataset(data)})
    content = storage.encoded(tree)
    stored = xr.open_groups(io.BytesIO(content), engine="h5netcdf")["/new"]
    assert {one.attrs.get("units", "") for one in stored.values()} == known
    assert {one.attrs["measured_in"] for one in stored.values() if "measured_in" in one.attrs} == ours - known
    assert all("units" not in one.attrs for one in stored.values() if one.attrs["long_name"] == "mixed")
    storage.write_finished(content, COMPLETE, tmp_path)
    xr.testing.assert_identical(storage.read_finished(tmp_path)[0]["new"].to_dataset(), xr.Dataset(data))


def test_the_table_of_variables_is_complete_and_names_errors_that_exist() -> None:
    lines = (Path(results.__file__).parent / "variables.tsv").read_text(encoding="utf-8").splitlines()
    cells = [line.split("\t") for line in lines[1:]]
    assert all(len(row) == len(lines[0].split("\t")) and all(cell == cell.strip() for cell in row) for row in cells)
    assert len({(group, variable) for group, variable, *_ in cells}) == len(cells)
    assert sum(map(len, GROUPS.values())) == len(cells)
    for group, variables in GROUPS.items():
        for name, variable in variables.items():
            assert 0 < len(variable.long_name) <= 40, f"/{group}/{name}"
            assert variable.comment, f"/{group}/{name}"
            assert variable.units or not variable.error, f"/{group}/{name} is a text with an error"
            if see := re.match(r"see (\w+)(?: of /(\w+))?", variable.error):
                assert see[1] in GROUPS[see[2] or group], f"/{group}/{name}: {variable.error}"
