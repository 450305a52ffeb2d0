from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path

import pytest
import xarray as xr

from tradestudy import report

_SPEC = importlib.util.spec_from_file_location("synthetic", Path(__file__).with_name("synthetic.py"))
assert _SPEC is not None
assert _SPEC.loader is not None
_synthetic = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(_synthetic)


@pytest.fixture(scope="session")
def make_tree() -> Callable[..., xr.DataTree]:
    return _synthetic.tree


RECORD: dict[str, object] = {"date": "2026-01-01", "versions": {"numpy": "2.0"}, "seconds": {"depth": 0.25}}


@pytest.fixture(scope="session")
def written(tree: xr.DataTree, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The whole report of the synthetic study, pages and figures."""
    directory = tmp_path_factory.mktemp("report")
    report.write(tree, RECORD, directory)
    return directory


@pytest.fixture(scope="session")
def record() -> dict[str, object]:
    return RECORD


@pytest.fixture(scope="session")
def tree() -> xr.DataTree:
    return _synthetic.tree()
