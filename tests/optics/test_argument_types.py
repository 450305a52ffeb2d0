"""Arguments of the wrong type are refused by name, with what is allowed and a remedy; lists become arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tradestudy import optics
from tradestudy.errors import OutOfRangeError

LENS = {"focal_length": 50e-3, "f_number": 8.0, "wavelength": 550e-9, "window": 4.0}
WRONG: list[tuple[str, Callable[..., Any], dict[str, Any]]] = [
    ("focal_length", optics.point_spread, LENS | {"focal_length": "50 mm"}),
    ("f_number", optics.point_spread, LENS | {"f_number": [2.8, 4.0]}),
    ("wavelength", optics.point_spread, LENS | {"wavelength": np.array([550e-9])}),
    ("wavelength", optics.point_spread, LENS | {"wavelength": 550e-9 + 1j}),
    ("pupil", optics.point_spread, LENS | {"pupil": {8: 0.1}}),
    ("source", optics.point_spread, LENS | {"source": (0.0, 0.0, 1.0)}),
    ("limits", optics.point_spread, LENS | {"limits": 3}),
    ("zernikes", optics.Pupil, {"zernikes": [0.0, 0.0, 1e-8]}),
    ("distance", optics.PointSource, {"distance": None}),
    ("centre", optics.TargetGrid.centred, {"centre": 0.0, "pitch": 1e-6, "count": 33, "distance": 1.0}),
    ("count", optics.TargetGrid.centred, {"centre": (0.0, 0.0), "pitch": 1e-6, "count": 2.5, "distance": 1.0}),
    ("x", optics.TargetPoints, {"x": "a", "y": 0.0, "distance": 1.0}),
    ("field", optics.window_share, {"field": np.ones((33, 33))}),
    ("nodes", optics.ApertureSamples, {"nodes": None, "field": np.ones(4)}),
]


@pytest.mark.parametrize(("name", "call", "arguments"), WRONG, ids=[f"{w[1].__name__}-{w[0]}" for w in WRONG])
def test_a_wrong_type_is_refused_by_name(name: str, call: Callable[..., Any], arguments: dict[str, Any]) -> None:
    with pytest.raises(OutOfRangeError) as refused:
        call(**arguments)
    assert refused.value.what == name
    assert "" not in (refused.value.value, refused.value.limit, refused.value.remedy)


def test_lists_become_arrays() -> None:
    table = optics.FocalLengths(
        field_angles=[0.0],  # type: ignore[arg-type]
        wavelengths=[550e-9],  # type: ignore[arg-type]
        focal_lengths=[[50e-3]],  # type: ignore[arg-type]
        reference_wavelength=550e-9,
    )
    assert table.at(field_angle=0.0, wavelength=550e-9) == 50e-3


def test_python_names_a_missing_argument() -> None:
    with pytest.raises(TypeError, match=r"point_spread\(\) missing .*'f_number'"):
        optics.point_spread(focal_length=50e-3, wavelength=550e-9)  # type: ignore[call-arg]
