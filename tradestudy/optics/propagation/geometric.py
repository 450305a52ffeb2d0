"""Rays only: intensity by the area that a pencil of rays covers, field by its path."""

from __future__ import annotations

import math
import time

import numpy as np

from tradestudy.errors import NotConvergedError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.propagation.kirchhoff import KirchhoffKernel
from tradestudy.optics.propagation.lens import LensWave
from tradestudy.optics.propagation.rays import find_rays, land, one_ray_per_target, ray_fields
from tradestudy.optics.propagation.result import ApertureField, Effort, NumericalError, squared_magnitude
from tradestudy.optics.propagation.targets import Targets
from tradestudy.optics.propagation.wave_optics import FieldAccuracy


def geometric_field(
    *, wave: LensWave, kernel: KirchhoffKernel, targets: Targets, accuracy: FieldAccuracy
) -> ApertureField:
    """Geometrical optics behind a lens: |U|² = Σ |A|²/|∂P/∂q| over the rays that reach a target.

    The field adds the rays with their phases (a caustic passed turns one by −i); the intensity adds them
    without interference. Both are 0 where no ray arrives and infinite on a caustic.

    The stated error comes from tracing neighbours of the rays to the check targets plainly: where they land, and
    the area that they cover, against the closed-form derivatives. It says nothing about diffraction.

    Parameters
    ----------
    wave
        Wave behind the lens, with exact paths.
    kernel
        Obliquity.
    targets
        Points or grid.
    accuracy
        Tolerance and check.

    Raises
    ------
    NotConvergedError
        Traced and computed intensities differ by more than the tolerance.
    """
    started = time.perf_counter()
    centre = wave.lens.centre
    x, y, z = targets.coordinates()
    x, y = x - centre[0], y - centre[1]
    rays = find_rays(wave, x, y, z, all_branches=not one_ray_per_target(wave, z))
    each = ray_fields(wave, kernel, rays, x, y, z)
    with np.errstate(invalid="ignore"):  # infinite field on a caustic: the sum over rays is infinite too
        field, intensity = each.sum(axis=0), squared_magnitude(each).sum(axis=0)
    seconds = time.perf_counter() - started
    started = time.perf_counter()
    rng = np.random.default_rng(accuracy.seed)
    index = rng.choice(x.size, size=min(accuracy.check_targets, x.size), replace=False)
    error, checked = _traced(wave, rays.u[:, index], rays.v[:, index], each[:, index], x[index], y[index], z[index])
    if error > accuracy.tolerance:
        raise NotConvergedError(
            "traced and computed ray intensities differ",
            value=f"{error:.2g}",
            limit=f"{accuracy.tolerance:g}",
            remedy="raise the tolerance, or move the targets off the caustic",
        )
    return ApertureField(
        field=np.asarray(field.reshape(targets.shape)),
        intensity=np.asarray(intensity.reshape(targets.shape)),
        error=NumericalError(field=error / 2, intensity=error, nodes=0.0, low_rank=0.0, nufft=0.0, check=error),
        effort=Effort(
            nodes=0,
            radial_nodes=0,
            angular_nodes=0,
            rank=0,
            tiles=1,
            rounds=1,
            seconds=seconds,
            check_seconds=time.perf_counter() - started,
            check_targets=checked,
        ),
        method="geometric",
    )


def _traced(
    wave: LensWave, u: FloatArray, v: FloatArray, each: np.ndarray, x: FloatArray, y: FloatArray, z: FloatArray
) -> tuple[float, int]:
    """Largest relative error of the intensity of single rays against tracing their neighbours, and how many."""
    lit = np.isfinite(each) & (np.abs(each) > 0)
    if not lit.any():
        return 0.0, 0
    x, y, z = (np.broadcast_to(c, lit.shape)[lit] for c in (x, y, z))
    u, v, intensity = u[lit], v[lit], squared_magnitude(each[lit])
    step = 1e-3 * wave.lens.radius
    derivatives = []
    for a, b in ((step, 0.0), (0.0, step)):
        near = [np.asarray(land(wave, u + m * a, v + m * b, z)) for m in (-2, -1, 1, 2)]
        derivatives.append((near[0] - 8 * near[1] + 8 * near[2] - near[3]) / (12 * step))
    area = np.abs(derivatives[0][0] * derivatives[1][1] - derivatives[0][1] * derivatives[1][0])
    expected = squared_magnitude(wave.amplitude(u, v)) / area
    landed = land(wave, u, v, z)
    miss = np.hypot(landed[0] - x, landed[1] - y)
    # A miss changes the intensity by at most its share of the distance over which the pencil doubles its area.
    spread = np.sqrt(area) * wave.lens.radius
    relative = np.abs(intensity / expected - 1) + miss / spread
    return float(relative.max() + 16 * math.ulp(1.0)), int(lit.sum())
