"""Corners that the stereo rig of the headline study would see of a chessboard, its true errors drawn beforehand.

    python -m tests.data.simulate_corners

writes ``stereo_65_corners.csv`` beside this file, in the form that ``studies/data/README.md`` describes: two cameras
of 8.0 mm (65.24° across 1024 pixels of 10 µm) 100 mm apart, and 30 views of a board of 9 × 6 corners, 45 mm apart, from
0.5 to 2.5 m. Nothing of the program takes part.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

FILE = Path(__file__).with_name("stereo_65_corners.csv")
PIXELS, PITCH, BASELINE = 1024, 10e-6, 0.1
FOCAL_PX = PIXELS / 2.0 / math.tan(math.radians(65.24) / 2.0)
COLUMNS, ROWS, SQUARE = 9, 6, 0.045
VIEWS, NOISE_PX = 30, 0.1
Numbers = np.ndarray[tuple[int, ...], np.dtype[np.float64]]


def true_rig() -> Numbers:
    """The rig that is simulated, shape (18,): of either camera f_x, f_y, c_x, c_y [px], k1, k2; rotation and shift.

    Yaw, pitch and roll lie within 0.2°, focal lengths within 0.1 %, the right camera within 0.2 mm of its place.
    """
    rng = np.random.default_rng(65)
    cameras = []
    for _ in range(2):
        focal = FOCAL_PX * (1.0 + rng.uniform(-1e-3, 1e-3))
        centre = (PIXELS - 1) / 2.0 + rng.uniform(-3.0, 3.0, 2)
        cameras.append([focal, focal, *centre, rng.uniform(-0.02, 0.02), rng.uniform(-0.01, 0.01)])
    rotation = np.radians(rng.uniform(-0.2, 0.2, 3))
    shift = np.array([-BASELINE, 0.0, 0.0]) + rng.uniform(-2e-4, 2e-4, 3)
    return np.array([*cameras[0], *cameras[1], *rotation, *shift])


def pictures(rig: Numbers, points: Numbers) -> Numbers:
    """Where both cameras image points (N, 3) of the left camera's frame [m], shape (N, 4) [px]."""
    moved = points @ Rotation.from_rotvec(rig[12:15]).as_matrix().T + rig[15:18]
    seen = []
    for camera, (x, y, z) in ((rig[:6], points.T), (rig[6:12], moved.T)):
        r2 = (x / z) ** 2 + (y / z) ** 2
        factor = 1.0 + camera[4] * r2 + camera[5] * r2**2
        seen += [camera[0] * x / z * factor + camera[2], camera[1] * y / z * factor + camera[3]]
    return np.stack(seen, axis=-1)


def board() -> Numbers:
    """Corners of the board about its middle, shape (54, 3) [m]."""
    x, y = np.meshgrid(np.arange(COLUMNS) - (COLUMNS - 1) / 2.0, np.arange(ROWS) - (ROWS - 1) / 2.0)
    return SQUARE * np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def simulate(rng: np.random.Generator) -> list[Numbers]:
    """Corners of every view in both pictures, shape (54, 4) each [px]; boards that leave a picture are shown again."""
    rig, corners = true_rig(), board()
    views: list[Numbers] = []
    while len(views) < VIEWS:
        distance = 0.5 * 5.0 ** ((len(views) + rng.random()) / VIEWS)
        turned = Rotation.from_rotvec(rng.normal(0.0, 0.35, 3)).as_matrix()
        middle = distance * np.array([*rng.uniform(-0.5, 0.5, 2), 1.0])
        seen = pictures(rig, corners @ turned.T + middle)
        if np.all((seen > 5.0) & (seen < PIXELS - 6.0)):
            views.append(seen + rng.normal(0.0, NOISE_PX, seen.shape))
    return views


def main() -> None:
    """Write the file."""
    with FILE.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        sides = [f"{side}_{axis}_px" for side in ("left", "right") for axis in ("x", "y")]
        writer.writerow(["view", "corner", "board_x_mm", "board_y_mm", *sides])
        for view, seen in enumerate(simulate(np.random.default_rng(0))):
            for corner, (place, image) in enumerate(zip(1e3 * board(), seen, strict=True)):
                writer.writerow([view, corner, *(f"{x:g}" for x in place[:2]), *(f"{u:.3f}" for u in image)])


if __name__ == "__main__":
    main()
