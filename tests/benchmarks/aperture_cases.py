"""Random cameras and sources for the audit of stated errors."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tradestudy.optics.propagation.aperture import aperture_field, lens_wave
from tradestudy.optics.propagation.kernels import FresnelKernel, KirchhoffKernel, direct_sum
from tradestudy.optics.propagation.lens import LENS_PHASES, OBLIQUITIES, CircularLens, LensWave, Obliquity, PointSource
from tradestudy.optics.propagation.result import ApertureField, Method
from tradestudy.optics.propagation.sampling import Limits, NodeCounts
from tradestudy.optics.propagation.targets import TargetGrid, TargetPoints
from tradestudy.optics.propagation.wave_optics import FieldAccuracy, nodes_for, sample_wave


@dataclass(frozen=True, kw_only=True)
class Case:
    """One random camera, source and window."""

    source: PointSource
    lens: CircularLens
    targets: TargetGrid | TargetPoints
    wavelength: float
    method: Method
    obliquity: Obliquity
    accuracy: FieldAccuracy


def random_case(rng: np.random.Generator, *, most_nodes: int = 12_000) -> Case:
    """Draw a camera; cases that need more than `most_nodes` nodes are drawn again, to keep the oracle affordable."""
    while True:
        case = _draw(rng)
        if nodes_for(_wave(case), _kernel(case), case.targets, case.accuracy).total <= most_nodes:
            return case


def _draw(rng: np.random.Generator) -> Case:
    focal_length = 10 ** rng.uniform(-3.5, -1.3)
    f_number = 10 ** rng.uniform(0.35, 1.2)
    wavelength = rng.uniform(400e-9, 700e-9)
    object_distance = focal_length * 10 ** rng.uniform(0.25, 2.0)
    angle = math.radians(8.0) * rng.random()
    bearing = rng.uniform(0, 2 * math.pi)
    source = PointSource(
        x=object_distance * math.tan(angle) * math.cos(bearing),
        y=object_distance * math.tan(angle) * math.sin(bearing),
        distance=object_distance,
    )
    phase = LENS_PHASES[rng.integers(3)]
    lens = CircularLens(
        radius=focal_length / f_number / 2,
        focal_length=focal_length,
        lens_phase=phase,
        focus_distance=object_distance * rng.uniform(0.8, 1.25) if phase == "stigmatic" else None,
    )
    x, y, b = lens.image_of(source)
    working = b / (2 * lens.radius)
    waves = rng.choice([0.0, 1.0]) * rng.normal(0.0, 5.0)  # of defocus at the rim; half of the cases are in focus
    distance = b + 8 * waves * wavelength * working**2
    distance = max(distance, 0.2 * b)
    scale = distance / b
    blur = max(abs(distance - b) / working, wavelength * working)
    pitch = blur * 10 ** rng.uniform(-1.3, -0.6)
    method: Method = "fresnel" if rng.random() < 0.2 else "kirchhoff"
    grid = TargetGrid.centred(
        centre=(x * scale + blur * rng.normal() * 0.3, y * scale + blur * rng.normal() * 0.3),
        pitch=pitch,
        count=int(rng.integers(16, 29)),
        distance=distance,
    )
    scattered = rng.random() < 0.3
    offsets = pitch * grid.x_count * (rng.random((2, grid.x_count**2)) - 0.5)
    points = TargetPoints(x=x * scale + offsets[0], y=y * scale + offsets[1], distance=distance)
    return Case(
        source=source,
        lens=lens,
        targets=points if scattered else grid,
        wavelength=wavelength,
        method=method,
        obliquity="paper" if method == "fresnel" else OBLIQUITIES[rng.integers(3)],
        accuracy=FieldAccuracy(tolerance=10 ** rng.uniform(-8, -2), seed=int(rng.integers(2**31))),
    )


def _wave(case: Case) -> LensWave:
    return lens_wave(
        source=case.source,
        lens=case.lens,
        wavelength=case.wavelength,
        paraxial=case.method == "fresnel",
        obliquity=case.obliquity,
    )


def _kernel(case: Case) -> FresnelKernel | KirchhoffKernel:
    if case.method == "fresnel":
        return FresnelKernel(wavelength=case.wavelength)
    return KirchhoffKernel(wavelength=case.wavelength, obliquity=case.obliquity)


def run(case: Case, *, node_share: float | None = None) -> ApertureField:
    """Compute a case; with `node_share`, on that share of the nodes it needs in each direction."""
    counts = None
    if node_share is not None:
        needed = nodes_for(_wave(case), _kernel(case), case.targets, case.accuracy)
        counts = NodeCounts(
            radial=max(1, round(node_share * needed.radial)), angular=max(1, round(node_share * needed.angular))
        )
    return aperture_field(
        source=case.source,
        lens=case.lens,
        targets=case.targets,
        wavelength=case.wavelength,
        method=case.method,
        accuracy=case.accuracy,
        obliquity=case.obliquity,
        limits=Limits(),
        counts=counts,
    )


def true_error(case: Case, result: ApertureField) -> float:
    """Relative L2 error of the intensity by direct quadrature at every target, on nodes for rounding accuracy."""
    wave = _wave(case)
    kernel = _kernel(case)
    counts = nodes_for(wave, kernel, case.targets, FieldAccuracy(tolerance=1e-10)).scaled(1.4)
    exact = direct_sum(sample_wave(wave, counts), kernel, *case.targets.coordinates())
    intensity = np.abs(exact.reshape(result.field.shape)) ** 2
    return float(np.linalg.norm(result.intensity - intensity) / np.linalg.norm(intensity))
