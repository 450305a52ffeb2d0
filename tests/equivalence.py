"""Did a refactor change a number? Every result of every study, before and after it.

    python -m tests.equivalence BEFORE AFTER
    python -m tests.equivalence --run OUT CHECKOUT_BEFORE CHECKOUT_AFTER

BEFORE and AFTER hold one finished run per study, ``<study>/results.nc``. With ``--run`` the shipped studies of two
checkouts are run first, into ``OUT/before`` and ``OUT/after``, with linear calibration forced wherever the study offers
it; runs that are finished there already, of the same study and code, are taken as they are.

Every group, variable, coordinate and attribute of BEFORE must be in AFTER. Texts, integers and flags must be equal, NaN
and infinities must lie in the same places, and numbers must agree to 1e-9 of themselves. A Markdown table goes to
standard output, then what is new and what failed; the exit status is 1 if anything failed. Nothing of the program is
imported, so that any two versions of it can be compared.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

LIMIT = 1e-9
RESULTS = "results.nc"
FORCED = ("--set", "effects.calibration=linear")
REFUSED = "offers nothing in this slot"
TEXT, FLOAT = "text", "float"

Group = xr.Dataset
Relabelled = Mapping[str, tuple[str, str, str]]
Scale = float | str | Callable[[Group], xr.DataArray]

# Group and variable → pattern, what replaces it on both sides, and why it was renamed.
_NO_KIND_OF_CAMERA = "the family asks formulas of two rays, and kinds of cameras are named in cameras/ alone"
RELABELLED: Relabelled = {
    "/hard_cases/family": ("^stereo$", "triangulation", _NO_KIND_OF_CAMERA),
    "/hard_cases/case": ("^stereo: ", "triangulation: ", _NO_KIND_OF_CAMERA),
}

# They hold wall times of the run itself, which differ between two runs of the same program. Times predicted for the
# reference machine do not, and are compared.
CLOCKS = frozenset({"posterior_seconds", "laplace_seconds"})

# They say which program computed the results and which file it read.
IGNORED_ATTRIBUTES = frozenset({"code_hash", "study_hash"})

# Differences of nearly equal numbers, in which rounding moves more than the last digits → the magnitude of which 1e-9
# is allowed instead: a number, a variable of the group, or what follows from the group.
SCALES: Mapping[str, Scale] = {
    # A result less that of a second method, or of a finer computation; shares of it, and margins divided by it.
    "/depth/depth_uncertainty_error": "depth_uncertainty",
    "/depth/depth_uncertainty_by_error_source_error": "depth_uncertainty_by_error_source",
    "/depth/depth_error_radius_error": "depth_error_radius",
    "/depth/depth_error_radius_by_error_source_error": "depth_error_radius_by_error_source",
    **dict.fromkeys(("/depth/failed_fraction", "/depth/failed_fraction_error", "/depth/variance_share"), 1.0),
    "/depth/disparity_error_px_error": "disparity_error_px",
    "/disparity_causes/disparity_error_px_error": "disparity_error_px",
    "/disparity_causes/disparity_error_px_changed_error": "disparity_error_px_changed",
    "/requirements/margin_sigma": lambda group: group["margin_sigma"] ** 2,
    **{f"/point_spread/{name}_error": name for name in ("full_width", "half_energy_radius", "energy_radius_80")},
    **{f"/point_spread/{name}_error": name for name in ("rms_width", "strehl_ratio", "transfer_half_nyquist")},
    **{f"/point_spread/{name}_error": name for name in ("outside_geometric", "neighbour_share")},
    # A ratio less one: margins, errors relative to a reference, changes by an effect. Behind the bound of calibration
    # errors stands such a change, too.
    "/requirements/margin_percent": 100.0,
    **dict.fromkeys(("/hard_cases/naive_error", "/hard_cases/our_error"), 1.0),
    **dict.fromkeys(("/effects/bound", "/effects/joint_bound"), 1.0),
    "/effects/number": lambda group: (group["slot"] == "calibration").astype(float),
    # A depth less another.
    **dict.fromkeys(("/sensitivity/source_uncertainty", "/sensitivity/source_uncertainty_error"), "distance"),
    # A covariance over a variance, 0 of most sources.
    **dict.fromkeys((f"/sensitivity/{name}" for name in ("first_index", "first_index_error")), 1.0),
    **dict.fromkeys((f"/sensitivity/{name}" for name in ("total_index", "total_index_error")), 1.0),
}
ALIKE = {"/depth_at_places": "/depth", "/depth_field": "/depth"}  # groups of the same variables


@dataclass(kw_only=True)
class Line:
    """One group of one study, and what was found in it."""

    study: str
    group: str
    variables: int = 0
    identical: int = 0
    largest: float = 0.0
    where: str = ""
    new: list[str] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    def cells(self) -> tuple[str, ...]:
        """Its row of the table."""
        largest = f"{self.largest:.1e}" if self.largest else "0"
        return self.study, self.group, str(self.variables), str(self.identical), largest, self.where or "—"


def read(path: Path) -> dict[str, Group]:
    """Groups of a results file by their paths."""
    return {name: group.load() for name, group in xr.open_groups(path, engine="h5netcdf").items()}


def compare_folders(before: Path, after: Path, studies: Sequence[str]) -> list[Line]:
    """Compare all runs of a folder, or those of some studies, with those of another folder."""
    lines = []
    finished = {path.parent.name for folder in (before, after) for path in folder.glob(f"*/{RESULTS}")}
    for study in studies or sorted(finished):
        old, new = (folder / study / RESULTS for folder in (before, after))
        if not new.is_file():
            lines.append(Line(study=study, group="/", failures=[f"{new}: no results here"]))
        else:
            lines += compare_results(study, read(old) if old.is_file() else {}, read(new))
    return lines


def compare_results(
    study: str, before: Mapping[str, Group], after: Mapping[str, Group], relabelled: Relabelled = RELABELLED
) -> list[Line]:
    """Compare two runs of a study, group by group."""
    lines = []
    for path in dict.fromkeys((*before, *after)):
        if path in before and path in after:
            groups = (_relabelled(path, side[path], relabelled) for side in (before, after))
            lines.append(_compare_groups(Line(study=study, group=path), *groups))
        elif path in before:
            lines.append(Line(study=study, group=path, failures=["vanished"]))
        else:
            lines.append(Line(study=study, group=path, new=["the group"]))
    return lines


def _relabelled(path: str, group: Group, relabelled: Relabelled) -> Group:
    """A group with labels as they are called now."""
    for where, (pattern, replacement, _) in relabelled.items():
        parent, _, name = where.rpartition("/")
        if parent == path and name in group.variables:
            old = group.variables[name]
            texts = np.array([re.sub(pattern, replacement, str(text)) for text in old.values.flat], dtype=object)
            group = group.assign({name: old.copy(data=texts.reshape(old.shape))})
    return group


def _compare_groups(line: Line, before: Group, after: Group) -> Line:
    _compare_attributes(line, "group", before.attrs, after.attrs)
    before, after = _with_common_labels(line, before, after)
    line.new += [str(name) for name in after.variables if name not in before.variables]
    for name in map(str, before.variables):
        if name not in after.variables:
            line.failures.append(f"{name}: vanished")
            continue
        a, b = before[name], after[name]
        _compare_attributes(line, name, a.attrs, b.attrs)
        if name not in CLOCKS:
            _compare_variables(line, a, b, _scale(before, line.group, name))
    return line


def _compare_attributes(line: Line, name: str, before: Mapping[Any, Any], after: Mapping[Any, Any]) -> None:
    line.new += [f"{name}: attribute {key}" for key in after if key not in before]
    for key, value in before.items():
        if key not in IGNORED_ATTRIBUTES and not (key in after and np.array_equal(value, after[key])):
            line.failures.append(f"{name}: attribute {key}: {value!r} → {after.get(key)!r}")


def _with_common_labels(line: Line, before: Group, after: Group) -> tuple[Group, Group]:
    """Both groups where their labels in words agree; what vanished has failed, what appeared is new."""
    for dim in before.dims:
        if any(dim not in group.coords or _kind(group[dim]) != TEXT for group in (before, after)):
            continue
        old, new = ([str(label) for label in group[dim].values] for group in (before, after))
        if len(set(old)) < len(old) or len(set(new)) < len(new):
            continue
        line.failures += [f"{dim}={label}: vanished" for label in old if label not in new]
        line.new += [f"{dim}={label}" for label in new if label not in old]
        before = before.isel({dim: [at for at, label in enumerate(old) if label in new]})
        after = after.isel({dim: [at for at, label in enumerate(new) if label in old]})
    return before, after


def _kind(array: xr.DataArray) -> str:
    """What an array holds, whatever its width in memory."""
    return {"f": FLOAT, "b": "flag", "i": "integer", "u": "integer"}.get(array.dtype.kind, TEXT)


def _scale(group: Group, path: str, name: str) -> xr.DataArray:
    """Magnitude that the change of a variable is measured by where the variable is smaller; 0 where there is none."""
    array = group[name]
    scale = xr.zeros_like(array, dtype=float)
    if (of := SCALES.get(f"{ALIKE.get(path, path)}/{name}")) is not None:
        scale = scale + np.abs(of(group) if callable(of) else group[of] if isinstance(of, str) else of)
    return scale.where(np.isfinite(scale), 0.0).transpose(*array.dims)


def _compare_variables(line: Line, before: xr.DataArray, after: xr.DataArray, scale: xr.DataArray) -> None:
    """Add one variable to the line of its group."""
    name, kind = str(before.name), _kind(before)
    line.variables += 1
    forms = [f"{_kind(array)} {dict(array.sizes)}" for array in (before, after)]
    if forms[0] != forms[1]:
        line.failures.append(f"{name}: {forms[0]} → {forms[1]}")
        return
    a, b = before.values, after.values
    same = a == b if kind != FLOAT else (a == b) | (np.isnan(a) & np.isnan(b))
    line.identical += bool(np.all(same) if kind != FLOAT else a.tobytes() == b.tobytes())
    change = np.where(same, 0.0, np.inf)  # what is no number, or finite on one side only, is the same or another
    if kind == FLOAT:
        moved = ~same & np.isfinite(a) & np.isfinite(b)
        largest = np.maximum(np.maximum(np.abs(a), np.abs(b)), scale.values)[moved]
        change[moved] = np.abs(a[moved] - b[moved]) / largest
    if not np.any(change):
        return
    at = np.unravel_index(int(change.argmax()), change.shape)
    where = f"{name}{_label(before, at)}"
    if change[at] > line.largest:
        line.largest, line.where = float(change[at]), where
    if beyond := np.count_nonzero(change > LIMIT):
        pair = f"{a.item(at)!r} → {b.item(at)!r}"
        line.failures.append(f"{where}: {pair}, {change[at]:.1e}; {beyond} of {change.size} beyond the limit")


def _label(array: xr.DataArray, at: Sequence[Any]) -> str:
    """Where an entry stands, by its coordinates."""
    places = [
        f"{dim}={array[dim].values[index] if dim in array.coords else index}"
        for dim, index in zip(array.dims, at, strict=True)
    ]
    return f" at {', '.join(places)}" if places else ""


def run_studies(python: Path, checkout: Path, out: Path, studies: Sequence[str]) -> None:
    """Run shipped studies of a checkout by its own program, each into a folder of its own."""

    def program(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [str(python.absolute()), "-m", "tradestudy", *arguments]
        return subprocess.run(command, cwd=checkout, env=environment, capture_output=True, text=True, check=False)

    environment = {**os.environ, "PYTHONPATH": str(checkout.absolute())}
    for name in studies or sorted(path.stem for path in (checkout / "studies").glob("*.yaml")):
        study, folder = f"studies/{name}.yaml", str(out.absolute() / name)
        forced = () if REFUSED in program("check", study, *FORCED).stderr else FORCED
        print(" ".join((str(checkout), name, *forced)), file=sys.stderr, flush=True)
        ended = program("run", study, "--quiet", "--no-pdf", "--out", folder, *forced)
        if ended.returncode:
            raise SystemExit(f"{checkout}: {name}: {ended.stderr}")


def reported(lines: Sequence[Line]) -> Iterator[str]:
    """The table, what is new, what was not compared, and what failed."""
    header = ("study", "group", "variables", "bit-identical", "largest relative difference", "where")
    yield f"| {' | '.join(header)} |"
    yield f"|{'---|' * len(header)}"
    yield from (f"| {' | '.join(line.cells())} |" for line in lines if line.variables)
    yield f"\nWall times, not compared: {', '.join(sorted(CLOCKS))}."
    for title, attribute in (("New", "new"), ("Failures", "failures")):
        found = [f"- {line.study}{line.group}: {what}" for line in lines for what in getattr(line, attribute)]
        yield "\n".join((f"\n{title}: {len(found) or 'none'}", *found))


def main() -> None:
    """Compare two folders of runs, made first if asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("before", type=Path, help="folder of runs; with --run a checkout of the program")
    parser.add_argument("after", type=Path, help="folder of runs; with --run a checkout of the program")
    parser.add_argument("--studies", nargs="+", default=[], help="only these, by the names of their files")
    parser.add_argument("--run", type=Path, metavar="OUT", help="run the studies first, into OUT/before and OUT/after")
    parser.add_argument("--python-before", type=Path, default=Path(sys.executable), help="interpreter of BEFORE")
    parser.add_argument("--python-after", type=Path, default=Path(sys.executable), help="interpreter of AFTER")
    given = parser.parse_args()
    before, after = given.before, given.after
    if given.run is not None:
        before, after = given.run / "before", given.run / "after"
        run_studies(given.python_before, given.before, before, given.studies)
        run_studies(given.python_after, given.after, after, given.studies)
    lines = compare_folders(before, after, given.studies)
    print("\n".join(reported(lines)))
    sys.exit(any(line.failures for line in lines) or not lines)


if __name__ == "__main__":
    main()
