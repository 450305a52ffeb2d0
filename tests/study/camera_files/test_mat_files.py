"""MATLAB files against scipy, which wrote them and reads them as well."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat
from scipy.sparse import csc_array

from tradestudy.study.camera_files.mat_files import UnreadArrayError, read

VALUES: dict[str, Any] = {
    "matrix": np.arange(6.0).reshape(2, 3),
    "row": np.array([1, -2, 300], dtype=np.int16),
    "many": np.linspace(-1.0, 1.0, 2000),
    "box": np.arange(24, dtype=np.uint8).reshape(2, 3, 4),
    "single": np.float32(0.1),
    "large": np.uint64(2**63),
    "yes": True,
    "words": "Kamera größer",
    "nested": {"a": {"b": np.eye(3)}, "text": "left", "cells": np.array([1.0, "two"], dtype=object)},
}


@pytest.mark.parametrize("do_compression", [False, True])
def test_values_are_those_that_scipy_reads(tmp_path: Path, do_compression: bool) -> None:
    path = tmp_path / "values.mat"
    savemat(path, VALUES, do_compression=do_compression)
    expected = {key: one for key, one in loadmat(path, simplify_cells=True).items() if not key.startswith("__")}
    found = read(path.read_bytes(), 1_000_000)
    assert found.keys() == expected.keys() == VALUES.keys()
    nested, cells = found["nested"], found["nested"].pop("cells")
    assert nested["text"] == "left"
    assert cells == [1.0, "two"]
    np.testing.assert_array_equal(nested["a"]["b"], np.eye(3))
    for name in VALUES.keys() - {"nested"}:
        np.testing.assert_array_equal(found[name], expected[name])
        np.testing.assert_array_equal(found[name], VALUES[name])


def test_structures_in_an_array_are_a_list(tmp_path: Path) -> None:
    two = np.zeros(2, dtype=[("f", object), ("side", object)])
    two["f"], two["side"] = [500.0, 501.0], ["left", "right"]
    savemat(tmp_path / "two.mat", {"cameras": two})
    cameras = read((tmp_path / "two.mat").read_bytes(), 1000)["cameras"]
    assert cameras == [{"f": 500.0, "side": "left"}, {"f": 501.0, "side": "right"}]


@pytest.mark.parametrize("value", [np.array([1.0 + 2.0j]), csc_array(np.eye(3))])
def test_arrays_that_would_lose_something_are_refused(tmp_path: Path, value: Any) -> None:
    savemat(tmp_path / "lossy.mat", {"K": value})
    with pytest.raises(UnreadArrayError, match="sparse or complex"):
        read((tmp_path / "lossy.mat").read_bytes(), 1000)


def test_a_file_that_unpacks_to_more_than_allowed_is_refused(tmp_path: Path) -> None:
    savemat(tmp_path / "large.mat", {"zeros": np.zeros(100_000)}, do_compression=True)
    with pytest.raises(ValueError, match="too large when unpacked"):
        read((tmp_path / "large.mat").read_bytes(), 100_000)
