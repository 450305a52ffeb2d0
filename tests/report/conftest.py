from __future__ import annotations

import importlib.util
from collections.abc import Callable
from pathlib import Path

import pytest
import xarray as xr

_SPEC = importlib.util.spec_from_file_location("synthetic", Path(__file__).with_name("synthetic.py"))
assert _SPEC is not None
assert _SPEC.loader is not None
_synthetic = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(_synthetic)


@pytest.fixture(scope="session")
def make_tree() -> Callable[..., xr.DataTree]:
    return _synthetic.tree


@pytest.fixture(scope="session")
def tree() -> xr.DataTree:
    return _synthetic.tree()
