"""Rows of a rig that is off its design: aligned as its exact geometry says, and left alone where they already are."""

import math

import cv2
import numpy as np
import pytest

from tradestudy.cameras.depth_measurement import Errors
from tradestudy.cameras.light_cones import Pose
from tradestudy.cameras.stereo.depth_reading import row_alignment
from tradestudy.cameras.stereo.pair import Pair, pair_interior, pair_observation, pair_poses
from tradestudy.optics.arrays import FloatArray

PIXEL = 10e-6
ROWS, COLUMNS = 400, 480
DISTANCE = 0.3
PAIR = Pair(baseline=0.02, principal_distance=8e-3, convergence_angle=0.0, triangulation="disparity")
STEPS = range(40, 66)  # 53.3 px at 0.3 m


def texture(x: FloatArray, y: FloatArray) -> FloatArray:
    """Brightness of a plane: waves of 8 to 30 px in all directions."""
    rng = np.random.default_rng(5)
    scale = DISTANCE * PIXEL / PAIR.principal_distance
    brightness = np.full(np.broadcast(x, y).shape, 1000.0)
    for length, angle, phase in zip(
        rng.uniform(8, 30, 60), rng.uniform(0, np.pi, 60), rng.uniform(0, 7, 60), strict=True
    ):
        brightness += 20.0 * np.cos(
            2.0 * np.pi * (x * math.cos(angle) + y * math.sin(angle)) / (length * scale) + phase
        )
    return brightness


def rays(rows: FloatArray, columns: FloatArray, interior: tuple[float, tuple[float, float]]) -> FloatArray:
    """Of places in a picture, shape (3, ...)."""
    distance, (x, y) = interior
    u, v = ((columns + 0.5 - COLUMNS / 2) * PIXEL - x) / distance, ((rows + 0.5 - ROWS / 2) * PIXEL - y) / distance
    return np.stack([u, v, np.ones_like(u)])


def picture(pose: Pose, interior: tuple[float, tuple[float, float]]) -> FloatArray:
    """Of the plane, by lines of sight."""
    rows, columns = np.indices((ROWS, COLUMNS)).astype(np.float64)
    x, y, z = np.einsum("ij,jrc->irc", np.array(pose.rotation), rays(rows, columns, interior))
    t = (DISTANCE - pose.centre[2]) / z
    return texture(pose.centre[0] + t * x, pose.centre[1] + t * y)


def taken(errors: Errors) -> tuple[FloatArray, FloatArray]:
    left, right = (
        picture(pose, pair_interior(PAIR, errors, side)[:2])
        for side, pose in zip(("left", "right"), pair_poses(PAIR, errors), strict=True)
    )
    noise = np.random.default_rng(1).normal(0.0, 1.0, (2, ROWS, COLUMNS))
    return left + noise[0], right + noise[1]


@pytest.mark.parametrize(
    "errors",
    [
        {"pitch": 0.003},
        {"roll": -0.01},
        {"right_principal_point_y": 45e-6},
        {"pitch": -0.004, "roll": 0.006, "yaw": 0.004, "right_focal_length": 40e-6},
    ],
    ids=["pitch", "roll", "shift", "all"],
)
def test_points_lie_in_their_row_after_alignment(errors: dict[str, float]) -> None:
    """Where the exact geometry images a point, the aligned picture shows its brightness in the row of the left one."""
    left, right = taken(errors)
    aligned = row_alignment(left, right, STEPS, cv2)(right)
    x, y = np.random.default_rng(2).uniform(-0.065, 0.065, (2, 4000))
    _, row, column, right_row = np.stack(pair_observation(PAIR, errors, x, y, np.full(x.shape, DISTANCE))) / PIXEL
    assert np.max(np.abs(right_row - row)) > 1.0
    row, column = row + ROWS / 2 - 0.5, column + COLUMNS / 2 - 0.5
    inside = (np.abs(column - COLUMNS / 2) < COLUMNS / 2 - 6) & (np.abs(row - ROWS / 2) < ROWS / 2 - 13)
    x, y, place = x[inside], y[inside], np.stack([column, row])[:, inside].astype(np.float32)
    seen = cv2.remap(aligned.astype(np.float32), *place, cv2.INTER_LANCZOS4).ravel()
    pixel = DISTANCE * PIXEL / PAIR.principal_distance
    slope = texture(x, y + 0.5 * pixel) - texture(x, y - 0.5 * pixel)
    difference = seen - texture(x, y)
    assert abs(np.sum(difference * slope) / np.sum(slope**2)) < 0.02
    assert np.sqrt(np.mean(difference**2) / np.mean(slope**2)) < 0.06  # px, in rows; noise alone makes 0.03


@pytest.mark.parametrize("errors", [{}, {"yaw": 5e-4}], ids=["as designed", "turned sideways"])
def test_rows_in_place_are_left_alone(errors: dict[str, float]) -> None:
    left, right = taken(errors)
    assert row_alignment(left, right, STEPS, cv2)(right) is right


def test_without_texture_rows_are_left_alone() -> None:
    left, right = np.random.default_rng(3).normal(1000.0, 5.0, (2, ROWS, COLUMNS))
    assert row_alignment(left, right, STEPS, cv2)(right) is right


@pytest.mark.parametrize("degrees", [0, 5, 20, 45, 60, 90])
@pytest.mark.parametrize("noise", [0.0, 5.0])
def test_ambiguous_texture_leaves_rows_alone(degrees: int, noise: float) -> None:
    """Waves of one direction, as of wood or fabric, fix no row; nor does one wave that repeats within the search."""
    rng, angle = np.random.default_rng(degrees), math.radians(degrees)
    rows, columns = np.indices((ROWS, COLUMNS + 50)).astype(np.float64)
    along = columns * math.cos(angle) + rows * math.sin(angle)
    for lengths in (rng.uniform(8.0, 30.0, 40), [7.0]):
        wide = 1000.0 + sum(20.0 * np.cos(2.0 * np.pi * along / length + rng.uniform(0.0, 7.0)) for length in lengths)
        left, right = wide[:, :COLUMNS], wide[:, 50:]
        left, right = (one + noise * rng.standard_normal(one.shape) for one in (left, right))
        assert row_alignment(left, right, STEPS, cv2)(right) is right


@pytest.mark.parametrize("shape", [(40, 100), (45, 200), (64, 64), (2000, 40)])
def test_small_pictures_are_left_alone(shape: tuple[int, int]) -> None:
    left, right = (
        picture(*at)[: shape[0], : shape[1]] for at in zip(pair_poses(PAIR, {}), [(8e-3, (0.0, 0.0))] * 2, strict=True)
    )
    noise = np.random.default_rng(4).normal(0.0, 60.0, (2, *left.shape))
    right = right + noise[1]
    assert row_alignment(left + noise[0], right, STEPS, cv2)(right) is right
