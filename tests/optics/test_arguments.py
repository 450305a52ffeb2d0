"""Arguments of the wrong type raise TypeError by name, impossible values are refused with limit and remedy."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pint
import pytest
import xarray as xr

from tradestudy import optics
from tradestudy.errors import OutOfRangeError

PINT = pint.UnitRegistry(cache_folder=None)
LENS: dict[str, Any] = {"focal_length": 50e-3, "f_number": 8.0, "wavelength": 550e-9, "window": 4.0}
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
    ("x", optics.TargetPoints, {"x": np.ma.array([0.0, 9e9], mask=[False, True]), "y": 0.0, "distance": 1.0}),
    ("f_number", optics.point_spread, LENS | {"f_number": True}),
    ("memory_bytes", optics.Limits, {"memory_bytes": 10**400}),
    ("field", optics.window_share, {"field": np.ones((33, 33))}),
    ("nodes", optics.ApertureSamples, {"nodes": None, "field": np.ones(4)}),
    ("x", optics.TargetPoints, {"x": 3.0 * PINT.mm, "y": 0.0, "distance": 1.0}),
    ("x", optics.TargetPoints, {"x": [3.0 * PINT.mm], "y": 0.0, "distance": 1.0}),
    ("x", optics.TargetPoints, {"x": xr.DataArray([3.0], attrs={"units": "mm"}), "y": 0.0, "distance": 1.0}),
    ("x", optics.TargetPoints, {"x": xr.DataArray([3.0] * PINT.mm), "y": 0.0, "distance": 1.0}),
]


@pytest.mark.parametrize(("name", "call", "arguments"), WRONG, ids=[f"{w[1].__name__}-{w[0]}" for w in WRONG])
def test_a_wrong_type_raises_by_name(name: str, call: Callable[..., Any], arguments: dict[str, Any]) -> None:
    with pytest.raises(TypeError, match=rf"^{name} must be (a|an|\d) .+, not "):
        call(**arguments)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda: optics.point_spread(**LENS, pupil={8: 0.1}),  # type: ignore[arg-type]
            "pupil must be a Pupil or None, not {8: 0.1}; give Pupil.from_waves({8: 0.1}, wavelength=550e-9) for a "
            "tenth of a wave of coma",
        ),
        (
            lambda: optics.MicrolensCamera(**CAMERA | {"odd_pixels": True}),
            "odd_pixels must be 2 values, (a, b), not True",
        ),
        (lambda: optics.point_spread(50e-3, 8.0), "point_spread() takes 0 positional arguments but 2 were given"),  # type: ignore[call-arg]
        (
            lambda: optics.microlens_image(
                optics.MicrolensCamera(**CAMERA),
                optics.PointSource(distance=0.5),
                wavelength=550e-9,
                legs="kirchhoff",  # type: ignore[arg-type]
            ),
            "legs must be a Legs, not 'kirchhoff'; give KIRCHHOFF, KIRCHHOFF_FRESNEL, FRESNEL, GEOMETRIC, EXACT_RAYS "
            "or Legs(…)",
        ),
    ],
)
def test_a_wrong_type_is_told_in_words(call: Callable[[], object], words: str) -> None:
    with pytest.raises(TypeError) as refused:
        call()
    assert str(refused.value) == words


def test_orders_instead_of_nolls_index_are_refused_with_the_remedy() -> None:
    with pytest.raises(OutOfRangeError, match=re.escape("Noll's j instead of (n, m)")):
        optics.noll_order((3, 1))  # type: ignore[arg-type]


def test_lists_become_arrays() -> None:
    table = optics.FocalLengths(
        field_angles=[0.0],  # type: ignore[arg-type]
        wavelengths=[550e-9],  # type: ignore[arg-type]
        focal_lengths=[[50e-3]],  # type: ignore[arg-type]
        reference_wavelength=550e-9,
    )
    assert table.at(field_angle=0.0, wavelength=550e-9) == 50e-3


def test_whole_numbers_of_few_bits_do_not_overflow() -> None:
    few: Any = np.int8(100)
    grid = optics.TargetGrid(
        x_start=0.0, y_start=0.0, x_pitch=1e-7, y_pitch=1e-7, x_count=few, y_count=few, distance=1.0
    )
    assert grid.x_count * grid.y_count == 10_000
    assert optics.noll_order(few) == optics.noll_order(100)
    assert optics.Pupil(zernikes={few: 1e-8}).path_terms(1.0)[0].value(np.ones(1), np.zeros(1)).dtype == np.float64


def test_numbers_of_single_precision_are_not_rounded_further() -> None:
    single: Any = np.float32(550e-9)
    assert optics.FresnelKernel(wavelength=single).wavenumber == 2 * np.pi / float(single)
    coefficient = optics.Pupil(zernikes={8: single}).zernikes[8]
    assert type(coefficient) is float


def test_python_names_a_missing_argument() -> None:
    with pytest.raises(TypeError, match=r"point_spread\(\) missing .*'f_number'"):
        optics.point_spread(focal_length=50e-3, wavelength=550e-9)  # type: ignore[call-arg]


CAMERA: dict[str, Any] = {
    "focal_length": 2e-3,
    "f_number": 8,
    "array_distance": 2.5e-3,
    "microlens_focal_lengths": 76e-6,
    "microlens_pitch": 26e-6,
    "gap": 0.1e-3,
    "pixel_pitch": 4e-6,
}
SPOT = optics.PointSpread(
    x=np.linspace(-4.0, 4.0, 33), y=np.linspace(-4.0, 4.0, 33), intensity=np.ones((33, 33)), pupil_power=64.0
)
STAR = optics.PointSource.at_infinity()
NOWHERE = np.full((1, 2), np.nan)
MICROLENS_CAMERA = optics.MicrolensCamera(
    focal_length=2e-3,
    f_number=8,
    array_distance=2.5e-3,
    microlens_focal_lengths=76e-6,
    microlens_pitch=26e-6,
    gap=0.1e-3,
    pixel_pitch=4e-6,
)
IMPOSSIBLE: dict[str, Callable[[], object]] = {
    "negative radius beside a valid one": lambda: optics.encircled_energy(
        SPOT, centre=(0.0, 0.0), radius=np.array([1.0, -1.0])
    ),
    "no radius": lambda: optics.encircled_energy(SPOT, centre=(0.0, 0.0), radius=np.array([])),
    "negative pitch": lambda: optics.pixel_shares(SPOT, pitch=-1.0, corner=(0.0, 0.0), shape=(1, 1)),
    "pitch that is not a number": lambda: optics.pixel_shares(SPOT, pitch=np.nan, corner=(0.0, 0.0), shape=(1, 1)),
    "too many pixels": lambda: optics.pixel_shares(SPOT, pitch=1e-9, corner=(0.0, 0.0), shape=(10**7, 10**7)),
    "angle in degrees": lambda: optics.full_width_at_half_maximum(SPOT, angle=90.0),
    "waves as metres": lambda: optics.point_spread(**LENS, pupil=optics.Pupil(zernikes={8: 0.1})),
    "radial and azimuthal order as Noll's index": lambda: optics.noll_order((3, 1)),  # type: ignore[arg-type]
    "waves in words": lambda: optics.Pupil.from_waves({8: "0.1"}, wavelength=550e-9),  # type: ignore[dict-item]
    "gap behind the array": lambda: optics.MicrolensCamera(**CAMERA | {"gap": -0.1e-3}),
    "pixel pitch in micrometres": lambda: optics.MicrolensCamera(**CAMERA | {"pixel_pitch": 4}),
    "infinite angle": lambda: optics.full_width_at_half_maximum(SPOT, angle=np.inf),
    "unequal frequencies": lambda: optics.modulation_transfer(SPOT, frequency_x=np.zeros(3), frequency_y=np.zeros(2)),
    "no wavelength": lambda: optics.FresnelKernel(wavelength=0.0),
    "negative wavelength of waves": lambda: optics.Pupil.from_waves({4: 0.1}, wavelength=-550e-9),
    "coefficient in words": lambda: optics.Pupil(zernikes={4: "a tenth"}),  # type: ignore[dict-item]
    "time limit that is not a number": lambda: optics.Limits(seconds=np.nan),
    "focal lengths of both signs": lambda: optics.FocalLengths(
        field_angles=np.array([0.0, 0.1]),
        wavelengths=np.array([550e-9]),
        focal_lengths=np.array([[50e-3], [-50e-3]]),
        reference_wavelength=550e-9,
    ),
    "zero distance": lambda: optics.diffraction_limited_peak(
        pupil_power=1.0, pupil_area=1.0, wavelength=550e-9, distance=0.0
    ),
    "lattice without pitch": lambda: optics.hexagonal_centres(pitch=0.0, rings=1),
    "complex amplitude": lambda: optics.point_spread(
        **LENS,
        pupil=optics.Pupil(amplitude=lambda x, _y: np.exp(1j * x)),
    ),
    "amplitude in words": lambda: optics.point_spread(
        **LENS,
        pupil=optics.Pupil(amplitude=lambda _x, _y: "half"),  # type: ignore[arg-type, return-value]
    ),
    "huge coefficient": lambda: optics.Pupil(zernikes={4: 10**400}),
    "infinite pitch": lambda: optics.TargetGrid.centred(centre=(0.0, 0.0), pitch=np.inf, count=3, distance=1.0),
    "rays behind a map": lambda: optics.point_spread(
        **LENS, method="boundary_wave", pupil=optics.Pupil(path=lambda x, _y: 1e-7 * x)
    ),
    "samples on a plane for an axis": lambda: optics.PointSpread(
        x=np.zeros((3, 11)), y=SPOT.y, intensity=SPOT.intensity, pupil_power=1.0
    ),
    "corner that is not a number": lambda: optics.pixel_shares(SPOT, pitch=1.0, corner=(np.nan, 0.0), shape=(1, 1)),
    "nodes about no point": lambda: optics.disc_nodes(
        radius=1.0, radial_count=2, angular_count=3, centre=(np.nan, 0.0)
    ),
    "no ring counts": lambda: optics.disc_nodes(radius=1.0, radial_count=2, angular_count=np.zeros(0, dtype=int)),
    "pixels about no point": lambda: optics.PixelGrid(pitch=1e-6, shape=(3, 3), centre=(np.nan, 0.0)),
    "microlens at no point": lambda: replace(
        MICROLENS_CAMERA.light_path(STAR, wavelength=550e-9).microlenses.only(0), centres=NOWHERE
    ),
    "microlenses on no plane": lambda: replace(
        MICROLENS_CAMERA.light_path(STAR, wavelength=550e-9).microlenses.only(0), centres=NOWHERE[0, 0]
    ),
    "dark main lens": lambda: optics.microlens_image(
        replace(MICROLENS_CAMERA, pupil=optics.Pupil(amplitude=lambda x, _y: 0.0 * x)), STAR, wavelength=550e-9
    ),
    "error of another shape": lambda: optics.Measured(value=np.ones(3), error=np.ones(2)),
}


@pytest.mark.parametrize("case", IMPOSSIBLE)
def test_an_impossible_value_is_refused_with_value_limit_and_remedy(case: str) -> None:
    with pytest.raises(OutOfRangeError) as refused:
        IMPOSSIBLE[case]()
    assert "" not in (refused.value.value, refused.value.limit, refused.value.remedy)


def test_plot_refuses_a_file_that_it_cannot_write(tmp_path: Path) -> None:
    psf = optics.point_spread(focal_length=50e-3, f_number=8.0, wavelength=550e-9, window=4.0)
    for file in (tmp_path / "spot.foo", tmp_path / "no folder" / "spot.svg"):
        with pytest.raises(OutOfRangeError, match="file of the plot"):
            psf.plot(file)


def test_an_image_on_the_array_is_refused_as_such() -> None:
    on_array = optics.PointSource(distance=10e-3)
    follows = replace(MICROLENS_CAMERA, microlens_phase="perfect")
    with pytest.raises(OutOfRangeError, match="on the microlens array"):
        optics.microlens_image(follows, on_array, wavelength=550e-9)


def test_arrays_without_any_number_can_be_printed() -> None:
    nothing = np.full(9, np.nan)
    assert "not numbers" in repr(optics.Measured(value=nothing, error=nothing))


def test_arrays_of_xarray_in_si_are_arrays() -> None:
    given = xr.DataArray([1e-3, 2e-3], attrs={"units": "m"})
    np.testing.assert_array_equal(optics.TargetPoints(x=given, y=0.0, distance=1.0).x, [1e-3, 2e-3])  # type: ignore[arg-type]
