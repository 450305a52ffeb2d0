"""Pictures of imported rigs, read by OpenCV with the imported calibration and by the program itself."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tradestudy import api
from tradestudy.answers.depth_loop import loop_points, measure_on_plane
from tradestudy.depth.evaluation import depth_uncertainty

pytestmark = pytest.mark.usefixtures("only_rays")

CASES = Path(__file__).parent / "data" / "render-imported"
SIZE = (320, 240)
PIXEL = 3e-6
WINDOW = 21  # px
DISTANCE = 0.8


def calibration(path: Path) -> tuple[Any, ...]:
    """K1, D1, K2, D2, R, T [m] of an OpenCV file in millimetres."""
    import cv2

    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    *interior, translation = (file.getNode(name).mat() for name in ("K1", "D1", "K2", "D2", "R", "T"))
    return (*interior, translation / 1000.0)


def errors_of_depth(folder: Path, known: tuple[Any, ...]) -> tuple[Any, Any]:
    """Depth errors [m] in the left camera's frame, and row offsets [px], of the rendered pair by OpenCV alone."""
    import cv2

    k1, d1, k2, d2, rotation, translation = known
    turn, turn2, p1, p2, q, _, _ = cv2.stereoRectify(k1, d1, k2, d2, SIZE, rotation, translation, alpha=0)
    own = ((k1, d1, turn, p1, "left"), (k2, d2, turn2, p2, "right"))
    rectified = []
    for k, d, r, p, side in own:
        taken = cv2.imread(str(folder / f"{side}.png"), cv2.IMREAD_UNCHANGED).astype(np.float32)
        # Light falls off towards the corners of both sensors alike, which is no disparity.
        texture = np.clip(128.0 + 100.0 * (taken / cv2.GaussianBlur(taken, (0, 0), 4.0) - 1.0), 0, 255)
        maps = cv2.initUndistortRectifyMap(k, d, r, p, SIZE, cv2.CV_32FC1)
        rectified.append(cv2.remap(texture.astype(np.uint8), *maps, cv2.INTER_CUBIC))
    places = np.stack(np.meshgrid(np.arange(60, 300, 10), np.arange(20, 220, 10)), -1).reshape(-1, 1, 2)
    places = places.astype(np.float32)
    expected = p1[0, 2] - p2[0, 2] + np.linalg.norm(translation) * p1[0, 0] / DISTANCE
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        *rectified,
        places,
        places - np.float32([expected, 0.0]),
        winSize=(WINDOW, WINDOW),
        maxLevel=0,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-4),
    )
    moved = (places - found)[:, 0]
    with_disparity = np.concatenate([places[:, 0], moved[:, :1]], axis=1)[:, None].astype(float)
    points = cv2.perspectiveTransform(with_disparity, q)[:, 0] @ turn  # in the frame of the left camera
    columns, rows = np.rint(cv2.projectPoints(points, np.zeros(3), np.zeros(3), k1, d1)[0][:, 0]).astype(int).T
    seen = (status[:, 0] == 1) & (columns >= 0) & (columns < SIZE[0]) & (rows >= 0) & (rows < SIZE[1])
    truth = cv2.imread(str(folder / "left_depth.tiff"), cv2.IMREAD_UNCHANGED)
    return points[seen, 2] - truth[rows[seen], columns[seen]], moved[seen, 1]


@pytest.fixture(scope="module", params=["raw", "toe", "pp"])
def taken(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """A case and the folder of its pictures and of the depth measured in them."""
    pytest.importorskip("cv2")
    folder = tmp_path_factory.mktemp(request.param)
    api.render(api.load(CASES / f"{request.param}.yaml"), folder, depth=True)
    return request.param, folder / "pictures" / "rig"


def test_opencv_measures_a_plane_with_the_imported_calibration(taken: tuple[str, Path]) -> None:
    """234 mm short when both pictures were those of two equal parallel cameras (``raw``)."""
    case, folder = taken
    camera = api.load(CASES / f"{case}.yaml").prepared.case.cameras["rig"]
    predicted = float(depth_uncertainty(camera, np.array([DISTANCE]), "noise")[0])
    errors, offsets = errors_of_depth(folder, calibration(CASES / f"{case}.yml"))
    assert errors.size > 400
    assert abs(np.median(errors)) < 0.2 * predicted
    assert abs(np.median(offsets)) < 0.02


def test_the_program_measures_the_plane_too(taken: tuple[str, Path]) -> None:
    _, folder = taken
    score = json.loads((folder / "depth_map.json").read_text(encoding="utf-8"))["score"]
    assert abs(score["relative_bias"]) < 0.05
    assert score["filled"] > 0.98


def test_the_pictures_are_described_as_by_the_calibration_file(taken: tuple[str, Path]) -> None:
    case, folder = taken
    k1, d1, k2, d2, rotation, translation = calibration(CASES / f"{case}.yml")
    pictures = json.loads((folder / "camera.json").read_text(encoding="utf-8"))["pictures"]
    for side, matrix, coefficients in (("left", k1, d1), ("right", k2, d2)):
        one = pictures[side]
        x, y = np.array(one["principal_point"]) / PIXEL + (np.array(SIZE) - 1.0) / 2.0
        found = [one["principal_distance"] / PIXEL, one["principal_distance_vertical"] / PIXEL, x, y]
        np.testing.assert_allclose(found, [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]], rtol=1e-12)
        np.testing.assert_allclose([one["distortion_k1"], one["distortion_k2"]], coefficients.ravel()[:2])
    left, right = (np.array(pictures[side]["rotation"]) for side in ("left", "right"))
    moved = np.array(pictures["left"]["centre"]) - np.array(pictures["right"]["centre"])
    np.testing.assert_allclose(right.T @ left, rotation, atol=1e-12)
    np.testing.assert_allclose(right.T @ moved, translation.ravel(), atol=1e-12)


def test_the_map_says_which_camera_it_belongs_to(taken: tuple[str, Path]) -> None:
    """Its points, placed in the scene, lie in the plane through (0, 0, 0.8 m)."""
    case, folder = taken
    frame = json.loads((folder / "depth_map.json").read_text(encoding="utf-8"))["frame"]
    depth = np.asarray(Image.open(folder / "depth_map_true.tiff"), np.float64)
    rows, columns = np.indices(depth.shape)
    x, y = np.array(frame["principal_point"]) / PIXEL + (np.array(SIZE) - 1.0) / 2.0
    c = frame["principal_distance"] / PIXEL
    rays = np.stack([(columns - x) / c, (rows - y) / c, np.ones_like(depth)], axis=-1)
    points = (depth[..., None] * rays) @ np.array(frame["rotation"]).T + np.array(frame["centre"])
    slope = np.tan(np.radians(10.0)) if case == "raw" else 0.0
    off = points[..., 2] - DISTANCE - slope * points[..., 0]
    assert np.nanmax(np.abs(off)) < 2e-5  # depth is interpolated between pixels


def test_a_depth_loop_uses_the_imported_calibration(tmp_path: Path) -> None:
    pytest.importorskip("cv2")
    text = (CASES / "raw.yaml").read_text(encoding="utf-8")
    loop = "depth_loop: {distances: [0.8 m, 1.2 m], fitted_at: [1.2 m], windows: 200}\n"
    (tmp_path / "loop.yaml").write_text(text[: text.index("  image:")] + loop, encoding="utf-8")
    (tmp_path / "raw.yml").write_bytes((CASES / "raw.yml").read_bytes())
    study = api.load(tmp_path / "loop.yaml").prepared
    assert study.file.depth_loop is not None
    first = next(iter(loop_points(study, study.file.depth_loop).values()))
    found = measure_on_plane(first)
    assert found.score is not None, found.reason
    assert found.score.filled > 0.95
    assert abs(found.score.relative_bias) < 0.05
