"""Images through main lens and microlenses by another program: quadrature over the pupil, then Fourier transforms."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.polynomial.legendre import leggauss
from scipy.interpolate import CubicSpline

from tradestudy.optics.chain.scene import LightPath

_RADII = 400


def angular_spectrum_image(
    path: LightPath,
    distance: float,
    wavelength: float,
    *,
    law: Literal["kirchhoff", "fresnel"],
    per_pixel: int,
    across: int,
) -> np.ndarray:
    """Fraction of the pupil's light on each pixel, for a point on the axis, a perfect main lens and parabolic lenses.

    The plane of the array is a periodic square of `across` cells of 1/`per_pixel` pixel, with apertures of soft edges
    one cell wide. The angular spectrum carries it to the detector, where all cells of a pixel are added.
    """
    h = path.pixels.pitch / per_pixel
    axis = h * (np.arange(across) - across // 2 + 0.5)
    x, y = np.meshgrid(axis + path.pixels.corner[0], axis + path.pixels.corner[1])
    x, y = (c - h * np.rint(path.pixels.corner[i] / h) for i, c in enumerate((x, y)))  # cells fit into pixels
    behind = _behind_array(path, x, y, _on_array(path, distance, wavelength, np.hypot(x, y), law), wavelength)
    frequency = wavelength * np.fft.fftfreq(across, h)
    squared = frequency**2 + frequency[:, None] ** 2
    slant = squared / 2 if law == "fresnel" else 1 - np.sqrt(1 - squared + 0j)  # evanescent waves fade
    turn = np.exp(-2j * np.pi / wavelength * path.detector_distance * slant)
    light = np.abs(np.fft.ifft2(np.fft.fft2(behind) * turn)) ** 2 * h**2
    column, row = (
        np.floor((c - corner) / path.pixels.pitch) for c, corner in zip((x, y), path.pixels.corner, strict=True)
    )
    inside = (column >= 0) & (column < path.pixels.shape[1]) & (row >= 0) & (row < path.pixels.shape[0])
    pixels = np.zeros(path.pixels.shape)
    np.add.at(pixels, (row[inside].astype(int), column[inside].astype(int)), light[inside])
    return pixels


def _on_array(path: LightPath, a: float, wavelength: float, rho: np.ndarray, law: str) -> np.ndarray:
    """Field on the array, per root of the pupil's power: an integral over the pupil at many radii."""
    k, z, lens = 2 * np.pi / wavelength, path.array_distance, path.main_lens
    b = a * lens.focal_length / (a - lens.focal_length)
    phase = k * lens.radius * float(rho.max()) / z  # from the middle of the lens to its rim, at the farthest point
    nodes, weights = leggauss(round(phase / 2) + 60)
    r, area = (nodes + 1) / 2 * lens.radius, weights / 2 * lens.radius * (nodes + 1) / 2 * lens.radius
    turn = np.cos(np.pi * (np.arange(round(phase / 2) + 30) + 0.5) / (round(phase / 2) + 30))  # of half a circle
    radii = np.linspace(0.0, rho.max(), _RADII)
    exact = law == "kirchhoff"
    wave = a / (a**2 + r**2) if exact else np.ones_like(r)
    field = np.empty(_RADII, dtype=complex)
    for n, s in enumerate(radii):
        apart = r[:, None] ** 2 + s**2 - 2 * r[:, None] * s * turn
        # Paths beyond those along the axis, and beyond that from the middle of the lens to the point.
        to_point = apart / (z + np.sqrt(z**2 + apart)) if exact else apart / (2 * z)
        own = s**2 / (z + np.sqrt(z**2 + s**2)) if exact else s**2 / (2 * z)
        to_image = r**2 / (b + np.sqrt(b**2 + r**2)) if exact else r**2 / (2 * b)
        kernel = z / (z**2 + apart) if exact else np.full_like(apart, 1 / z)
        field[n] = np.sum((area * wave)[:, None] * kernel * np.exp(1j * k * (to_point - own - to_image[:, None])))
    field *= 2 * np.pi / turn.size / wavelength / np.sqrt(2 * np.pi * np.sum(area * wave**2))
    own = rho**2 / (z + np.sqrt(z**2 + rho**2)) if exact else rho**2 / (2 * z)
    return np.asarray(CubicSpline(radii, field)(rho) * np.exp(1j * k * own))


def _behind_array(path: LightPath, x: np.ndarray, y: np.ndarray, field: np.ndarray, wavelength: float) -> np.ndarray:
    """Field behind circular apertures with parabolic lenses in an opaque plate."""
    lenses = path.microlenses
    h = float(x[0, 1] - x[0, 0])
    passed = np.zeros_like(field)
    for (centre_x, centre_y), focal_length in zip(lenses.centres, lenses.focal_lengths, strict=True):
        squared = (x - centre_x) ** 2 + (y - centre_y) ** 2
        open_part = np.clip(0.5 + (lenses.aperture_width / 2 - np.sqrt(squared)) / h, 0.0, 1.0)
        passed += open_part * np.exp(-1j * np.pi * squared / wavelength / focal_length)
    return np.asarray(field * passed)
