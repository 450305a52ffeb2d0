"""Limits of memory and time hold for every method, and are refused as limits, not as impossible arguments."""

from __future__ import annotations

import pytest

from tradestudy import optics
from tradestudy.errors import UnaffordableError
from tradestudy.optics.propagation.aperture import METHODS
from tradestudy.optics.propagation.result import Method

DEFOCUSED = optics.TargetGrid.centred(centre=(0.0, 0.0), pitch=2e-6, count=65, distance=25e-3)


def aperture(targets: optics.TargetGrid, method: Method, limits: optics.Limits) -> optics.ApertureField:
    return optics.aperture_field(
        source=optics.PointSource(distance=0.5),
        lens=optics.CircularLens(radius=2e-3, focal_length=25e-3, lens_phase="perfect"),
        targets=targets,
        wavelength=550e-9,
        method=method,
        accuracy=optics.FieldAccuracy(tolerance=1e-2),
        limits=limits,
    )


@pytest.mark.parametrize("method", METHODS)
def test_a_nanosecond_is_too_little(method: Method) -> None:
    with pytest.raises(UnaffordableError) as refused:
        aperture(DEFOCUSED, method, optics.Limits(seconds=1e-9))
    assert "1e-09 s" in refused.value.limit


@pytest.mark.parametrize("method", METHODS)
def test_a_kilobyte_is_too_little(method: Method) -> None:
    with pytest.raises(UnaffordableError, match="memory"):
        aperture(DEFOCUSED, method, optics.Limits(memory_bytes=1e3))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("count", [10**5, 10**10, 10**30])
def test_a_grid_beyond_all_memory_is_refused_before_it_is_made(method: Method, count: int) -> None:
    def attempt() -> optics.ApertureField:
        grid = optics.TargetGrid.centred(centre=(0.0, 0.0), pitch=1e-3 / count, count=count, distance=25e-3)
        return aperture(grid, method, optics.Limits())

    with pytest.raises(UnaffordableError) as refused:
        attempt()
    assert "" not in (refused.value.value, refused.value.limit, refused.value.remedy)
