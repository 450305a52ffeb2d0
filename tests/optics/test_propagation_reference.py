"""Fields against a table of 30 digits, and the fast path against direct quadrature."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

from tradestudy.optics.propagation.aperture import aperture_field, lens_wave
from tradestudy.optics.propagation.kernels import ApertureSamples, FresnelKernel, KirchhoffKernel, direct_sum
from tradestudy.optics.propagation.lens import LENS_PHASES, OBLIQUITIES, CircularLens, PointSource
from tradestudy.optics.propagation.sampling import NodeCounts
from tradestudy.optics.propagation.targets import TargetGrid, TargetPoints
from tradestudy.optics.propagation.wave_optics import FieldAccuracy, nodes_for, propagate_samples, sample_wave
from tradestudy.optics.quadrature import rectangle_nodes

TABLE = json.loads((Path(__file__).parent / "reference" / "aperture_table.json").read_text())
MAIN = {"radius": 12.5e-3 / 7.6, "focal_length": 12.5e-3}


def lens(phase: str, focus: float = 0.15, **geometry: float) -> CircularLens:
    return CircularLens(**(geometry or MAIN), lens_phase=phase, focus_distance=focus if phase == "stigmatic" else None)


@pytest.mark.parametrize("row", TABLE, ids=lambda r: f"{r['method']}-{r['obliquity']}-{r['lens_phase']}-{r['x']:g}")
def test_fields_agree_with_thirty_digits(row: dict):
    result = aperture_field(
        source=PointSource(x=row["source_x"], y=row["source_y"], distance=row["object_distance"]),
        lens=lens(row["lens_phase"], row["focus_distance"], radius=row["radius"], focal_length=row["focal_length"]),
        targets=TargetPoints(x=row["x"], y=row["y"], distance=row["distance"]),
        wavelength=row["wavelength"],
        method=row["method"],
        obliquity=row["obliquity"],
        accuracy=FieldAccuracy(tolerance=1e-9),
    )
    exact = complex(float(row["real"]), float(row["imag"]))
    # The phase of 1.7e6 radians over 0.15 m keeps ten digits in double precision; the magnitude more.
    assert abs(complex(result.field[()]) - exact) < 2e-9 * abs(exact)
    error = abs(float(result.intensity[()]) / abs(exact) ** 2 - 1)
    assert error < max(1e-11, result.error.intensity)
    assert error < 1e-8


CASES = [
    *[("kirchhoff", phase, "paper") for phase in LENS_PHASES],
    *[("kirchhoff", "parabolic", obliquity) for obliquity in OBLIQUITIES[1:]],
    ("fresnel", "parabolic", "paper"),
]


@pytest.mark.parametrize(("method", "phase", "obliquity"), CASES)
@pytest.mark.parametrize("shape", ["grid", "points", "surface"])
def test_the_fast_path_equals_direct_quadrature_at_every_target(method: str, phase: str, obliquity: str, shape: str):
    source, element = PointSource(x=1.5e-3, y=-1e-3, distance=0.15), lens(phase)
    x, y, b = element.image_of(source)
    grid = TargetGrid(
        x_start=x - 15e-6, y_start=y - 9e-6, x_pitch=0.7e-6, y_pitch=0.5e-6, x_count=42, y_count=37, distance=b
    )
    targets = grid
    if shape != "grid":
        px, py, pz = grid.coordinates()
        tilt = 0.3 * (px - x) + 0.1 * (py - y) if shape == "surface" else 0.0
        targets = TargetPoints(
            x=px.reshape(grid.shape), y=py.reshape(grid.shape), distance=(pz + tilt).reshape(grid.shape)
        )
    wave = lens_wave(source=source, lens=element, wavelength=550e-9, paraxial=method == "fresnel", obliquity=obliquity)
    kernel = (
        FresnelKernel(wavelength=550e-9)
        if method == "fresnel"
        else KirchhoffKernel(wavelength=550e-9, obliquity=obliquity)
    )
    result = aperture_field(
        source=source,
        lens=element,
        targets=targets,
        wavelength=550e-9,
        method=method,
        obliquity=obliquity,
        accuracy=FieldAccuracy(tolerance=1e-7),
    )
    assert result.effort.rank > 0  # the fast path did run
    assert result.field.shape == targets.shape
    counts = nodes_for(wave, kernel, targets, FieldAccuracy(tolerance=1e-9))
    exact = direct_sum(sample_wave(wave, counts), kernel, *targets.coordinates()).reshape(targets.shape)
    intensity = np.abs(exact) ** 2
    error = np.linalg.norm(result.intensity - intensity) / np.linalg.norm(intensity)
    assert error <= result.error.intensity <= 1e-7
    assert np.linalg.norm(result.field - exact) <= result.error.field * np.linalg.norm(exact)


def test_direct_quadrature_itself_converges_to_rounding():
    source, element = PointSource(x=2e-3, distance=0.15), lens("parabolic")
    wave = lens_wave(source=source, lens=element, wavelength=550e-9)
    kernel = KirchhoffKernel(wavelength=550e-9, obliquity="paper")
    x, y, b = element.image_of(source)
    targets = TargetPoints(x=x + np.asarray([-40e-6, 0.0, 40e-6]), y=y + 40e-6, distance=b)
    needed = nodes_for(wave, kernel, targets, FieldAccuracy(tolerance=1e-10))
    fields = {
        share: direct_sum(sample_wave(wave, needed.scaled(share)), kernel, *targets.coordinates())
        for share in (0.6, 0.7, 0.8, 1.0, 1.5)
    }
    error = {s: np.abs(f - fields[1.5]).max() / np.abs(fields[1.5]).max() for s, f in fields.items()}
    assert error[1.0] < 1e-11
    assert error[0.6] > 10 * error[0.7] > 100 * error[0.8]  # geometric convergence, not luck
    assert error[0.6] > 1e-2  # and an undersampled oracle would have agreed with nobody


def test_wide_targets_are_split_and_still_right():
    source = PointSource(x=0.0, distance=5e-3)
    element = lens("perfect", radius=24e-6, focal_length=0.4e-3)
    grid = TargetGrid.centred(centre=(0.2e-3, -0.1e-3), pitch=12e-6, count=48, distance=0.5e-3)
    result = aperture_field(
        source=source,
        lens=element,
        targets=grid,
        wavelength=550e-9,
        method="kirchhoff",
        accuracy=FieldAccuracy(tolerance=1e-5),
    )
    assert result.effort.tiles > 1
    wave = lens_wave(source=source, lens=element, wavelength=550e-9)
    counts = NodeCounts(radial=result.effort.radial_nodes, angular=result.effort.angular_nodes).scaled(1.2)
    some = np.argsort(-result.intensity.ravel())[::70]
    x, y, z = (c[some] for c in grid.coordinates())
    exact = direct_sum(sample_wave(wave, counts), KirchhoffKernel(wavelength=550e-9, obliquity="paper"), x, y, z)
    assert np.linalg.norm(result.field.ravel()[some] - exact) < result.error.field * np.linalg.norm(exact)


def test_forward_and_reversed_propagation_are_adjoint():
    """⟨A x, y⟩ = ⟨x, A* y⟩ with A* y = conj(Kᵀ conj y): the same code run from the targets to the aperture."""
    rng = np.random.default_rng(5)
    kernel = KirchhoffKernel(wavelength=550e-9, obliquity="rayleigh-sommerfeld-1")
    distance, accuracy = 0.6e-3, FieldAccuracy(tolerance=1e-9)
    near = rectangle_nodes(width=80e-6, height=60e-6, counts=(24, 20), centre=(10e-6, 5e-6))
    far = rectangle_nodes(width=50e-6, height=90e-6, counts=(22, 25), centre=(-20e-6, 30e-6))
    x = rng.normal(size=near.count) + 1j * rng.normal(size=near.count)
    y = rng.normal(size=far.count) + 1j * rng.normal(size=far.count)
    there = propagate_samples(
        samples=ApertureSamples(nodes=near, field=x),
        kernel=kernel,
        targets=TargetPoints(x=far.x, y=far.y, distance=distance),
        accuracy=accuracy,
    )
    back = propagate_samples(
        samples=ApertureSamples(nodes=far, field=y.conj()),
        kernel=kernel,
        targets=TargetPoints(x=near.x, y=near.y, distance=distance),
        accuracy=accuracy,
    )
    assert min(there.effort.rank, back.effort.rank) > 0
    assert math.isnan(there.error.nodes)  # an array cannot be sampled anew
    left = np.sum(there.field * y.conj() * far.weights)
    right = np.sum(x * back.field * near.weights)
    size = np.sqrt(np.sum(np.abs(there.field) ** 2 * far.weights) * np.sum(np.abs(y) ** 2 * far.weights))
    assert abs(left - right) < 1e-9 * size
