"""What `tradestudy.optics` offers: found by `dir`, and loaded when asked for."""

from __future__ import annotations

import inspect
import subprocess
import sys

import pytest

from tradestudy import optics


def test_the_package_lists_exactly_its_public_names() -> None:
    assert dir(optics) == sorted(optics.__all__)
    assert not [name for name in dir(optics) if name.startswith("_") or inspect.ismodule(getattr(optics, name))]
    with pytest.raises(AttributeError, match="no attribute 'point_spreed'"):
        optics.point_spreed  # noqa: B018


def test_importing_it_loads_no_heavy_library() -> None:
    code = (
        "import sys, tradestudy.optics.lateral_resolution; from tradestudy.optics import arrays; "
        "print([m for m in ('scipy', 'finufft', 'matplotlib') if m in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
