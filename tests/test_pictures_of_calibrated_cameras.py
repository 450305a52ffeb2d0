"""Pictures of imported single cameras, held against OpenCV with the imported calibration."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tradestudy
from tradestudy import api
from tradestudy.cameras.camera import DerivedValue
from tradestudy.errors import TradestudyError

pytestmark = pytest.mark.usefixtures("only_rays")

SIZE = (160, 120)
DISTANCE, TILT = 0.8, math.radians(10.0)
MATRIX = np.array([[150.0, 0.0, 88.0], [0.0, 142.0, 51.5], [0.0, 0.0, 1.0]])
PINHOLE = np.array([-0.21, 0.06, 0.004, -0.003, 0.0])
FISHEYE = np.array([-0.03, 0.01, 0.0, 0.0])
STUDY = (Path(__file__).parent / "data" / "render-imported" / "raw.yaml").read_text(encoding="utf-8")


def imported(folder: Path, model: str, said: str = "focus: {distance: 1 m}") -> Path:
    """A study with one camera from a file that OpenCV wrote, before a plane turned about the y axis."""
    cv2 = pytest.importorskip("cv2")
    storage = cv2.FileStorage(str(folder / "eye.yml"), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", SIZE[0])
    storage.write("image_height", SIZE[1])
    storage.write("camera_matrix", MATRIX)
    storage.write("distortion_coefficients", PINHOLE if model == "pinhole" else FISHEYE)
    storage.release()
    camera = f"from: eye.yml\n    lens_model: {model}\n    sensor: {{pixel_pitch: 3 um}}\n    {said}\n"
    before, _, after = STUDY.partition("from: raw.yml")
    text = before + camera + after[after.index("    lenses:") :].replace("lenses:", "lens:", 1)
    text = text.replace("    focus_distance: 1 m\n", "").replace("    depth_maps: true\n", "")
    (folder / "eye.yaml").write_text(text, encoding="utf-8")
    return folder / "eye.yaml"


def projected(model: str, points: np.ndarray) -> np.ndarray:
    """Pixels of points (n, 3), by OpenCV."""
    import cv2

    project: Any = cv2.projectPoints if model == "pinhole" else cv2.fisheye.projectPoints
    given = PINHOLE if model == "pinhole" else FISHEYE
    return np.asarray(project(points[:, np.newaxis], np.zeros(3), np.zeros(3), MATRIX, given)[0].reshape(-1, 2))


@pytest.mark.parametrize("model", ["pinhole", "fisheye"])
def test_every_pixel_sees_the_point_that_opencv_images_there(model: str, tmp_path: Path) -> None:
    """The true depth of a tilted plane at each pixel, on the ray that OpenCV projects there."""
    import cv2

    api.render(api.load(imported(tmp_path, model)), tmp_path)
    folder = tmp_path / "pictures" / "rig"
    depth = cv2.imread(str(folder / "image_depth.tiff"), cv2.IMREAD_UNCHANGED).astype(float)
    rows, columns = np.indices(depth.shape)
    pixels = np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float)
    slopes = (pixels - MATRIX[:2, 2]) / np.diag(MATRIX)[:2]
    for _ in range(60):  # corrected until OpenCV projects them to the pixels
        slopes += (pixels - projected(model, np.column_stack([slopes, np.ones(len(slopes))]))) / np.diag(MATRIX)[:2]
    across = slopes[:, 0]
    # On the ray x = s z, the plane z = Z + x tan(tilt) lies at Z / (1 - s tan(tilt)).
    expected = DISTANCE / (1.0 - across.reshape(depth.shape) * math.tan(TILT))
    seen = np.isfinite(depth)
    assert seen.mean() > 0.95
    np.testing.assert_allclose(depth[seen], expected[seen], rtol=2e-5)
    said = json.loads((folder / "camera.json").read_text(encoding="utf-8"))["pictures"]["image"]
    found = np.array([said["principal_distance"], said["principal_distance_vertical"], *said["principal_point"]]) / 3e-6
    middle = (np.array(SIZE) - 1.0) / 2.0
    np.testing.assert_allclose(found, [150.0, 142.0, *(MATRIX[:2, 2] - middle)], rtol=1e-9)


@pytest.mark.parametrize("model", ["pinhole", "fisheye"])
def test_points_lie_in_the_picture_where_opencv_projects_them(model: str, tmp_path: Path) -> None:
    camera = tradestudy.load(imported(tmp_path, model)).definition.designs["rig"]
    (exposure,) = camera.exposures(1.0, {}, None, 0.0)
    world = np.random.default_rng(5).uniform([-0.4, -0.3, 0.8], [0.4, 0.3, 1.5], (40, 3))
    expected = projected(model, world)
    found = exposure.place(*world.T).T / 3e-6 + (np.array(SIZE) - 1.0) / 2.0
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_the_field_of_view_is_that_of_the_lens_model(tmp_path: Path) -> None:
    import cv2

    camera = tradestudy.load(imported(tmp_path, "fisheye")).definition.designs["rig"]
    ends = np.array([[[-0.5, 51.5]], [[159.5, 51.5]]])
    slopes = cv2.fisheye.undistortPoints(ends, MATRIX, FISHEYE)[:, 0, 0]
    expected = math.degrees(math.atan(slopes[1]) - math.atan(slopes[0]))
    said = dict(camera.properties())["horizontal field of view, as calibrated"]
    assert isinstance(said, DerivedValue)
    assert math.degrees(said.value) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ("focus: {distance: 1 m, stack: {from: 0.8 m, to: 1.2 m, images: 5}}", "holds for one focus setting"),
        ("focus: {distance: 1 m}\n    geometry: null", "give exactly one of focal_length and field_of_view"),
    ],
)
def test_what_contradicts_the_calibrated_geometry_is_refused(said: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(TradestudyError, match=message):
        tradestudy.load(imported(tmp_path, "pinhole", said))
