from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tests.test_stored_results import COMPLETE
from tradestudy import report
from tradestudy.report import csv_tables, html
from tradestudy.report.words import interval
from tradestudy.result import Result
from tradestudy.results import FORMAT_VERSION, storage
from tradestudy.wording import distance


def _content(directory: Path) -> dict[str, bytes]:
    return {p.relative_to(directory).as_posix(): p.read_bytes() for p in directory.rglob("*") if p.is_file()}


def _quick(tree: xr.DataTree, *more: str) -> xr.DataTree:
    """A part of the tree that draws one figure only, so that a report of it is quick to write."""
    return xr.DataTree.from_dict({f"/{name}": tree[name].to_dataset() for name in ("cameras", "claims", *more)})


def test_the_same_results_give_the_same_files(tree: xr.DataTree, tmp_path: Path) -> None:
    tree = _quick(tree, "decision", "assumptions")
    report.write(tree, {"date": "today"}, tmp_path / "a", pdf=False)
    report.write(tree, {"date": "tomorrow"}, tmp_path / "b", pdf=False)
    a, b = _content(tmp_path / "a"), _content(tmp_path / "b")
    assert a.keys() == b.keys()
    assert {name for name in a if a[name] != b[name]} == {"report.html"}
    before, _, after = a["report.html"].partition(b"How this report was made")
    assert before == b["report.html"].partition(b"How this report was made")[0]
    assert after.replace(b"today", b"tomorrow") == b["report.html"].partition(b"How this report was made")[2]


def test_results_in_memory_and_on_disk_give_the_same_report(
    tree: xr.DataTree, record: dict[str, object], written: Path, tmp_path: Path
) -> None:
    on_disk = tree.copy()
    on_disk.attrs["format_version"] = FORMAT_VERSION
    storage.write_finished(storage.encoded(on_disk), {**COMPLETE, **record}, tmp_path / "run")
    report.write(storage.read_finished(tmp_path / "run")[0], record, tmp_path / "report")
    again = _content(tmp_path / "report")
    assert again == _content(written)
    assert again["report.pdf"].startswith(b"%PDF-")


def test_an_old_report_stays_whole_until_the_new_one_is_complete(
    tree: xr.DataTree, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report.write(_quick(tree), {}, tmp_path, pdf=False)
    before = _content(tmp_path)

    def fail(*_: object) -> bytes:
        raise KeyboardInterrupt

    monkeypatch.setattr(html, "render_html", fail)
    with pytest.raises(KeyboardInterrupt):
        report.write(_quick(tree), {"date": "new"}, tmp_path, pdf=False)
    assert _content(tmp_path) == before


def test_a_report_that_cannot_be_made_costs_no_results(
    tree: xr.DataTree, record: dict[str, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> bytes:
        raise KeyboardInterrupt

    monkeypatch.setattr(html, "render_html", fail)
    kept = _quick(tree)
    kept.attrs["format_version"] = FORMAT_VERSION
    with pytest.raises(KeyboardInterrupt):
        Result(data=kept, run_record={**COMPLETE, **record}).write(tmp_path, pdf=False)
    assert _content(tmp_path).keys() == {"results.nc", "run.json"}
    assert storage.read_finished(tmp_path)[0].identical(kept)


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "x"
    storage.replace_file(target, b"old")

    def full(_: int) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(OSError, match="no space"):
        storage.replace_file(target, b"new")
    assert _content(tmp_path) == {"x": b"old"}


def test_figures_and_tables_of_an_earlier_report_are_removed(tree: xr.DataTree, tmp_path: Path) -> None:
    report.write(_quick(tree, "decision", "assumptions"), {}, tmp_path, pdf=False)
    assert (tmp_path / "figures/readings.svg").exists()
    assert (tmp_path / "tables/assumptions_by_path.csv").exists()
    (tmp_path / "results.nc").write_bytes(b"mine")
    report.write(_quick(tree), {}, tmp_path, pdf=False)
    assert not list((tmp_path / "figures").glob("*"))
    assert {p.name for p in (tmp_path / "tables").iterdir()} == set(csv_tables.tables(_quick(tree)))
    assert (tmp_path / "results.nc").read_bytes() == b"mine"


def test_a_large_table_is_written_on_request(
    tree: xr.DataTree, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_tables, "LARGE", 1.0)
    monkeypatch.setattr(csv_tables, "_FEW", 0)
    report.write(_quick(tree), {}, tmp_path, pdf=False)
    assert not list((tmp_path / "tables").glob("*"))
    report.write(_quick(tree), {}, tmp_path, pdf=False, large_tables=True)
    assert {p.name for p in (tmp_path / "tables").iterdir()} == set(csv_tables.tables(_quick(tree)))


def test_tables_hold_every_number_with_all_its_digits(tree: xr.DataTree) -> None:
    table = b"".join(csv_tables.tables(tree)["depth_by_camera_distance_error_source.csv"]).decode()
    rows = list(csv.DictReader(io.StringIO(table)))
    depth = tree["depth"].to_dataset()
    assert len(rows) == depth["depth_uncertainty_by_error_source"].size
    for row in rows[:: len(rows) // 50]:
        where = {"camera": row["camera"], "distance": float(row["distance [m]"]), "error_source": row["error_source"]}
        assert float(row["depth_uncertainty_by_error_source [m]"]) == float(
            depth["depth_uncertainty_by_error_source"].sel(where)
        )


def test_text_in_tables_is_quoted_and_never_a_formula() -> None:
    names = np.array(['=cmd|" /C calc"!A0', 'a,"b"\nc', "+1", "-x", "@y", "plain"], dtype=object)
    group = xr.Dataset({"name": ("row", names), "value": ("row", np.array([-1.0, np.inf, np.nan, 0.1, 1e-300, 2.0]))})
    pieces = csv_tables.tables(xr.DataTree.from_dict({"/g": group.assign_coords(row=range(6))}))["g_by_row.csv"]
    rows = list(csv.DictReader(io.StringIO(b"".join(pieces).decode(), newline="")))
    assert [row["name"] for row in rows] == ['\'=cmd|" /C calc"!A0', 'a,"b"\nc', "'+1", "'-x", "'@y", "plain"]
    assert [row["value"] for row in rows] == ["-1.0", "inf", "nan", "0.1", "1e-300", "2.0"]


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (0.2951, 0.3073, "0.295 – 0.307 m"),
        (5.9375, 31.667, "5.9 – 31.7 m"),
        (5.9375, np.inf, "5.94 m – ∞"),
        (0.0212, 0.0214, "21.20 – 21.40 mm"),
    ],
)
def test_intervals_have_one_unit_and_the_digits_that_matter(low: float, high: float, text: str) -> None:
    assert interval(low, high).replace("\u00a0", " ") == text


def test_distances_are_written_as_on_the_axes() -> None:
    assert [distance(x).replace("\u00a0", " ") for x in (0.05, 0.391, 10.0, np.inf)] == [
        "50 mm",
        "0.391 m",
        "10 m",
        "∞",
    ]
