"""Rays that sample a picture evenly: the numbers that place them, and the way from the array to the pixels."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.chain.exact_lines import Plane, turned
from tradestudy.optics.chain.scene import LightPath, Microlenses, PixelGrid

AT_ONCE = 100_000  # rays in a block
Tracer = Callable[[int, int, int], FloatArray]
"""Sum over the rays of a shifted sequence from one member to another, shape of the pixels."""


def even_numbers(dimensions: int, shifted: int, start: int, stop: int) -> FloatArray:
    """Members of a sequence that fills the unit cube evenly however far it is followed, shape (dimensions, n).

    Multiples of 1/g, 1/g², … for g^(d+1) = g + 1: a golden ratio for every dimension. Each of its shifts errs on its
    own, as if drawn: √p j² modulo 1 for prime p has no period that a step could share.
    """
    g = 2.0
    for _ in range(60):
        g = math.pow(1.0 + g, 1.0 / (dimensions + 1))
    steps = np.power(g, -np.arange(1.0, dimensions + 1))
    shift = np.sqrt([2.0, 3.0, 5.0, 7.0][:dimensions]) * (shifted + 1) ** 2
    return np.asarray((shift[:, None] + np.arange(start, stop) * steps[:, None]) % 1.0)


def on_disc(radius: float, area: FloatArray, turn: FloatArray) -> Plane:
    """Points at shares of the area of a disc from its middle, and at shares of a turn."""
    distance, angle = radius * np.sqrt(area), 2.0 * math.pi * turn
    return Plane(x=distance * np.cos(angle), y=distance * np.sin(angle))


def through_microlens(path: LightPath, index: int, offset: Plane, arriving: Plane, power: FloatArray) -> FloatArray:
    """Rays that reach a microlens's plane at points relative to its centre, on the pixels where they land."""
    lenses = path.microlenses
    in_lens = in_aperture(lenses, offset)
    parts = [(in_lens, True)]
    if lenses.gaps == "clear":
        parts.append((in_cell(lenses, offset) & ~in_lens, False))
    total = np.zeros(path.pixels.shape)
    x, y = lenses.centres[index]
    for inside, acting in parts:
        here, slope = offset.where(inside), arriving.where(inside)
        leaving = turned(lenses.lens(index), here, slope, backward=False) if acting else slope
        landing = here.plus(leaving, path.detector_distance)
        total += _on_pixels(path.pixels, landing.beside(-x, -y), power[inside])
    return total


def _on_pixels(pixels: PixelGrid, landing: Plane, power: FloatArray) -> FloatArray:
    """Sum of what lands on each."""
    rows, columns = pixels.shape
    left, low = pixels.corner
    column, row = (landing.x - left) / pixels.pitch, (landing.y - low) / pixels.pitch
    hit = (column >= 0.0) & (column < columns) & (row >= 0.0) & (row < rows)
    flat = row[hit].astype(np.intp) * columns + column[hit].astype(np.intp)
    sums = np.bincount(flat, weights=power[hit], minlength=rows * columns)
    return np.asarray(sums.reshape(rows, columns), dtype=np.float64)  # of no ray at all they are integers


def in_aperture(lenses: Microlenses, offset: Plane) -> BoolArray:
    """Whether points relative to the centre of a microlens lie on it."""
    half = lenses.aperture_width / 2.0
    if lenses.aperture == "circular":
        return np.asarray(offset.squared <= half**2)
    return np.asarray(np.maximum(np.abs(offset.x), np.abs(offset.y)) <= half)


def in_cell(lenses: Microlenses, offset: Plane) -> BoolArray:
    """Whether they lie in its cell."""
    half, x, y = lenses.pitch / 2.0, np.abs(offset.x), np.abs(offset.y)
    if lenses.layout == "square":
        return np.asarray(np.maximum(x, y) <= half)
    return np.asarray(np.maximum(x, x / 2.0 + y * math.sqrt(3.0) / 2.0) <= half)
