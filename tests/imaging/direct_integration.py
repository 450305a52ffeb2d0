"""A small plenoptic camera, and its picture of a plane by integrating the light of every point of it forwards.

Pictures by waves follow light of pixels backwards, through one microlens at a time, and by tables. Here every source
point sends its light through the pupil onto the array, through all microlenses at once, in phase, and onto points of
the pixels, by Fresnel's integral; fringes between microlenses included. The microlenses are but 24 µm wide.
"""

from __future__ import annotations

import numpy as np
from scipy.special import j0

from tradestudy.cameras.microlens_exposure import ArrayGeometry, MicrolensExposure
from tradestudy.cameras.parts import Lens, MicrolensArray, Sensor
from tradestudy.optics.arrays import FloatArray

WAVELENGTH = 550e-9
PIXEL, PITCH, GAP, Z = 4e-6, 24e-6, 108e-6, 6e-3
DISTANCE, VIRTUAL_DEPTH = 60e-3, 2.5
IMAGE = Z - VIRTUAL_DEPTH * GAP
F = 1.0 / (1.0 / DISTANCE + 1.0 / IMAGE)
PUPIL = PITCH * Z / GAP
F_L = 1.0 / (1.0 / GAP + 1.0 / (2.1 * GAP))  # out of focus
PIXELS, PARTS = 14, 3
SPACING = 4.1e-6 * DISTANCE / IMAGE  # of source points; no multiple of the fringes between microlenses
SINUSOIDS = ((0.021, 0.013, 0.3), (-0.008, 0.034, 1.1), (0.05, -0.02, 2.0))  # cycles per µm of the image, and phases
K = 2 * np.pi / WAVELENGTH


def exposure() -> MicrolensExposure:
    sensor = Sensor(columns=PIXELS, rows=PIXELS, pixel_pitch=PIXEL)
    return MicrolensExposure(
        name="raw",
        sensor=sensor,
        main_lens=Lens(focal_length=F, f_number=F / PUPIL),
        microlenses=MicrolensArray(
            layout="hexagonal", pitch=PITCH, gap=GAP, focal_lengths=(F_L,), aperture_diameter=PITCH
        ),
        geometry=ArrayGeometry(
            focal_length=F, mla_distance=Z, gap=GAP, pitch=PITCH, corner=sensor.diagonal / 2.0, field_curvature=0.0
        ),
        errors={},
        reference_distance=DISTANCE,
    )


def brightness(x: FloatArray, y: FloatArray) -> FloatArray:
    """Of the plane, upright, at places [m] on it."""
    micrometres = 1e6 * IMAGE / DISTANCE
    waves = [np.cos(2 * np.pi * (a * x + b * y) * micrometres + c) for a, b, c in SINUSOIDS]
    return np.asarray(1.0 + 0.3 * np.sum(waves, axis=0))


def integrated_picture() -> FloatArray:
    """Light on the pixels, upright, in a unit of its own.

    Everything is written upright: behind the main lens x is turned by 180°, so that a source at s lands at s z/a.
    """
    half = PIXELS * PIXEL / 2 + (VIRTUAL_DEPTH / 2 + 1.5) * PITCH
    steps = np.ceil(half * DISTANCE / IMAGE / SPACING)
    s_x, s_y = (one.ravel() for one in np.meshgrid(*(2 * [SPACING * np.arange(-steps, steps + 1)])))
    value, source = brightness(s_x, s_y), s_x + 1j * s_y
    # On the array U = exp(ik x²/2z) V(|x − s z/a|), V the transform of the pupil out of focus.
    t, weight = np.polynomial.legendre.leggauss(400)
    rho, far = PUPIL / 2 * np.sqrt((t + 1) / 2), np.linspace(0.0, 1.2e-3, 6000)
    pupil = weight * np.exp(0.5j * K * rho**2 * (1 / DISTANCE - 1 / F + 1 / Z))
    v = j0(K / Z * np.outer(far, rho)) @ pupil
    t, weight = np.polynomial.legendre.leggauss(12)
    eta = np.outer(PITCH / 2 * np.sqrt((t + 1) / 2), np.exp(2j * np.pi * np.arange(44) / 44)).ravel()
    through = np.repeat(weight, 44) * np.exp(-0.5j * K * abs(eta) ** 2 / F_L)
    i, j = (one.ravel() for one in np.meshgrid(np.arange(-6, 7), np.arange(-6, 7)))
    centres = PITCH * (i + j / 2 + 1j * np.sqrt(0.75) * j)
    reach = PIXELS * PIXEL / 2 + 0.9 * PITCH
    centres = centres[(abs(centres.real) < reach) & (abs(centres.imag) < reach)]
    places = ((np.arange(PIXELS * PARTS) + 0.5) / PARTS - PIXELS / 2) * PIXEL
    sigma = (places[None, :] + 1j * places[:, None]).ravel()
    light = np.zeros(sigma.size)
    for some in np.array_split(np.arange(source.size), 12):
        field = np.zeros((sigma.size, some.size), np.complex64)
        for centre in centres:
            near, x = np.flatnonzero(abs(sigma - centre) < 0.9 * PITCH), centre + eta
            away = abs(x[:, None] - source[some] * Z / DISTANCE)
            u = np.interp(away, far, v)
            u *= (through * np.exp(0.5j * K * abs(x) ** 2 / Z))[:, None]
            to_sensor = np.exp(0.5j * K / GAP * abs(sigma[near, None] - x) ** 2)
            field[near] += to_sensor.astype(np.complex64) @ u.astype(np.complex64)
        light += (np.square(field.real) + np.square(field.imag)) @ value[some]
    return light.reshape(PIXELS, PARTS, PIXELS, PARTS).sum(axis=(1, 3))
