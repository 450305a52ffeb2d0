"""The speed of the machine: measured in less than a second, remembered, and never believed where it cannot be."""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path

import pytest

from tradestudy import machine


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    calls: list[int] = []

    def measure() -> dict[str, float]:
        calls.append(1)
        return {name: 2.0 * seconds for name, seconds in machine.REFERENCE_SECONDS.items()}

    monkeypatch.setattr(machine, "measure_kernels", measure)
    return calls


def test_measuring_takes_no_more_than_a_second_and_names_every_kernel_of_the_reference() -> None:
    begin = time.process_time()
    found = machine.measure_kernels()
    assert time.process_time() - begin < 1.0
    assert set(found) == set(machine.REFERENCE_SECONDS)
    assert all(0.0 < seconds < 1.0 for seconds in found.values())


def test_speed_is_the_geometric_mean_of_the_kernels() -> None:
    fourfold = {
        name: seconds * (4.0 if "Fourier" in name else 1.0) for name, seconds in machine.REFERENCE_SECONDS.items()
    }
    assert machine.speed_of(machine.REFERENCE_SECONDS) == pytest.approx(1.0, rel=1e-12)
    assert machine.speed_of(fourfold) == pytest.approx(4.0 ** (-1 / 4), rel=1e-12)


def test_a_machine_is_measured_once(tmp_path: Path, counted: list[int]) -> None:
    assert machine.machine_speed(tmp_path / "new") == pytest.approx(0.5)
    assert machine.machine_speed(tmp_path / "new") == pytest.approx(0.5)
    assert len(counted) == 1
    assert [path.name for path in (tmp_path / "new").iterdir()] == [machine.FILE]


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[: len(text) // 2],
        lambda text: "[]",
        lambda text: text.replace(" 0.5", " NaN"),
        lambda text: text.replace(" 0.5", " -3.0"),
        lambda text: text.replace(" 0.5", ' "fast"'),
        lambda text: text.replace('"cores": ', '"cores": 1'),
        lambda text: text.replace('"numpy": "', '"numpy": "0.'),
        lambda text: text.replace('"format": 1', '"format": 2'),
    ],
)
def test_what_cannot_be_believed_is_measured_anew(tmp_path: Path, counted: list[int], damage: object) -> None:
    machine.machine_speed(tmp_path)
    file = tmp_path / machine.FILE
    damaged = damage(file.read_text())  # type: ignore[operator]
    assert damaged != file.read_text()
    file.write_text(damaged)
    assert machine.machine_speed(tmp_path) == pytest.approx(0.5)
    assert len(counted) == 2
    assert json.loads(file.read_text())["speed"] == pytest.approx(0.5)


def test_a_folder_that_cannot_be_made_is_no_error(tmp_path: Path, counted: list[int]) -> None:
    (tmp_path / "taken").write_text("a file where the folder would be")
    assert machine.machine_speed(tmp_path / "taken") == pytest.approx(0.5)
    assert machine.machine_speed(tmp_path / "taken") == pytest.approx(0.5)
    assert len(counted) == 2


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="nothing is read-only to the superuser")
def test_a_read_only_folder_is_used_as_it_is(tmp_path: Path, counted: list[int]) -> None:
    machine.machine_speed(tmp_path)
    (tmp_path / machine.FILE).write_text("{}")
    tmp_path.chmod(0o555)
    try:
        assert machine.machine_speed(tmp_path) == pytest.approx(0.5)
    finally:
        tmp_path.chmod(0o755)
    assert [path.name for path in tmp_path.iterdir()] == [machine.FILE]


def test_the_cache_folder_follows_the_custom_of_the_system(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert machine.cache_folder() == tmp_path / "tradestudy"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert machine.cache_folder() == Path.home() / ".cache" / "tradestudy"
    monkeypatch.setattr(sys, "platform", "darwin")
    assert machine.cache_folder() == Path.home() / "Library" / "Caches" / "tradestudy"
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setenv("LOCALAPPDATA", str(tmp_path))
    assert machine.cache_folder() == tmp_path / "tradestudy"
