"""Pairs of cameras with different pictures and focal lengths, against rays with noise, OpenCV and counted points."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import tradestudy
from tests.study.camera_files import everybody
from tests.study.camera_files.everybody import L1, L2
from tests.study.camera_files.test_devices import said_by
from tests.study.camera_files.test_import import calibrated, refusal
from tests.study.camera_files.written import K1, R, T, study
from tradestudy import api
from tradestudy.answers.export import ExportError, export
from tradestudy.cameras.calibrated_pair import common_focal_length
from tradestudy.errors import TradestudyError

FINE, COARSE = ((1920, 1080), 1400.0, (961.0, 537.5)), ((640, 400), 420.0, (317.25, 201.0))
TURN, MOVED = np.array([0.02, 0.1, -0.03]), np.array([-0.07, 0.004, 0.006])
NOISE = 0.2  # px, of the disparity
DISTANCES = np.array([0.5, 1.0, 3.0])


def camera(first: Any = FINE, second: Any = COARSE, right_pitch: str = "3 um", **said: Any) -> Any:
    sides = {
        side: {"focal_length": [f"{f} px"] * 2, "principal_point": [f"{one} px" for one in centre]}
        for side, (_, f, centre) in (("left", first), ("right", second))
    }
    pose = {"rotation": [f"{one} rad" for one in TURN], "translation": [f"{one} m" for one in MOVED]}
    return tradestudy.camera(
        "stereo",
        sensor={"pixels": list(first[0]), "pixel_pitch": "1.5 um"},
        right_sensor={"pixels": list(second[0]), "pixel_pitch": right_pitch},
        **{"geometry": {**sides, **pose}, "depth": {"disparity_error": f"{NOISE} px"}, **said},
    )


def projections(first: Any, second: Any) -> tuple[np.ndarray, np.ndarray]:
    ks = [np.array([[f, 0, x], [0, f, y], [0, 0, 1]]) for _, f, (x, y) in (first, second)]
    return ks[0] @ np.eye(3, 4), ks[1] @ np.c_[cv2.Rodrigues(TURN)[0], MOVED]


def midway(z: float) -> np.ndarray:
    """The point at z on the line that starts between the cameras and bisects their axes."""
    turn = cv2.Rodrigues(TURN)[0]
    axis, centre = turn[2] + [0, 0, 1], -turn.T @ MOVED
    return np.r_[0.5 * centre[:2] + z * axis[:2] / axis[2], z, 1.0]


@pytest.mark.parametrize("pair", [(FINE, COARSE), (COARSE, FINE)])
def test_noise_in_pixels_of_each_camera_becomes_that_of_depth(pair: tuple[Any, Any]) -> None:
    """Two rays with noise, met in the plane of the baseline; OpenCV's least squares also use the rows."""
    rng, draws, rig = np.random.default_rng(1), 400_000, camera(*pair)
    projection = projections(*pair)
    for z in DISTANCES:
        seen = [(p @ midway(z))[:2, None] / (p @ midway(z))[2] for p in projection]
        noisy = [np.repeat(one, draws, 1) for one in seen]
        for one in noisy:
            one[0] += rng.normal(0.0, NOISE / np.sqrt(2.0), draws)
        x, y, w = np.linalg.inv(projection[0][:, :3]) @ np.vstack([noisy[0], np.ones(draws)])
        right = (noisy[1][0] - pair[1][2][0]) / pair[1][1]
        turned = cv2.Rodrigues(TURN)[0] @ np.stack([x / w, y / w, np.ones(draws)])
        on_ray = (MOVED[0] - right * MOVED[2]) / (right * turned[2] - turned[0])
        homogeneous = cv2.triangulatePoints(*projection, *(one[:, : draws // 5] for one in noisy))
        by_opencv = homogeneous[2] / homogeneous[3]
        expected, least_squares = (
            np.diff(np.quantile(one, [0.158655, 0.841345]))[0] / 2.0 for one in (on_ray, by_opencv)
        )
        assert float(rig.depth_uncertainty(z)) == pytest.approx(expected, rel=5e-3)
        assert float(rig.depth_uncertainty(z)) == pytest.approx(least_squares, rel=2e-2)


def test_the_coarser_picture_limits_depth() -> None:
    """Two coarse pictures have twice the variance of one of them, to which a fine one adds a little."""
    exact = np.sqrt((1.0 / 1400.0**2 + 1.0 / 420.0**2) / 2.0)
    assert 1.0 / float(common_focal_length(1400.0, 420.0)) == pytest.approx(exact, rel=1e-14)
    assert float(common_focal_length(882.5, 882.5)) == 882.5
    coarse, unequal, fine = (
        float(camera(*pair).depth_uncertainty(1.0)) for pair in ((COARSE, COARSE), (FINE, COARSE), (FINE, FINE))
    )
    assert coarse / np.sqrt(2.0) < unequal < 0.75 * coarse
    assert unequal > 2.0 * fine


@pytest.mark.parametrize("pair", [(FINE, COARSE), (COARSE, FINE)])
def test_the_more_blurred_picture_limits_the_usable_range(pair: tuple[Any, Any]) -> None:
    """Lenses of f/2 focused at 1 m blur a point at infinity over f²/(2 (1 m − f) p) pixels."""
    rig = camera(*pair, lenses={"f_number": 2.0}, focus_distance="1 m")._calibrated
    focal_lengths = [f * pitch for (_, f, _), pitch in zip(pair, (1.5e-6, 3e-6), strict=True)]
    blurs = [f**2 / (2.0 * (1.0 - f) * pitch) for f, pitch in zip(focal_lengths, (1.5e-6, 3e-6), strict=True)]
    assert float(rig.estimator_blur_px(np.array([np.inf]))[0]) == pytest.approx(max(blurs), rel=1e-2)


def test_an_equal_pair_needs_no_second_sensor() -> None:
    alone = camera(FINE, FINE, "1.5 um")
    without = alone.replace({"right_sensor": None})
    for name in ("depth_uncertainty", "depth_error_radius"):
        np.testing.assert_array_equal(getattr(alone, name)(DISTANCES), getattr(without, name)(DISTANCES))


@pytest.mark.parametrize("pair", [(FINE, COARSE), (COARSE, FINE)])
def test_overlap_is_the_share_of_points_that_the_other_picture_shows(pair: tuple[Any, Any]) -> None:
    rig, turn = camera(*pair), cv2.Rodrigues(TURN)[0]
    design = rig._calibrated
    for z in DISTANCES:
        shares = []
        for own, other, forth in ((0, 1, True), (1, 0, False)):
            (columns, rows), f, centre = pair[own]
            u, v = np.meshgrid((np.arange(600) + 0.5) / 600 * columns - 0.5, (np.arange(600) + 0.5) / 600 * rows - 0.5)
            rays = np.stack([(u - centre[0]) / f, (v - centre[1]) / f, np.ones_like(u)]).reshape(3, -1)
            if forth:
                there = turn @ (rays * z) + MOVED[:, None]
            else:
                start, back = -turn.T @ MOVED, turn.T @ rays
                there = start[:, None] + back * (z - start[2]) / back[2]
            size, c, middle = pair[other]
            x, y = (c * there[k] / there[2] + middle[k] for k in (0, 1))
            shares.append(np.mean((x > -0.5) & (x < size[0] - 0.5) & (y > -0.5) & (y < size[1] - 0.5)))
        assert float(design.overlap(np.array([z]))[0]) == pytest.approx(min(shares), abs=4e-3)


def test_errors_of_the_right_camera_are_in_its_own_pixels() -> None:
    """A moved principal point changes the slope of its rays by 1/c of its own camera."""
    moved = {"errors": {"right_principal_point_x": {"standard_deviation": "0.3 px"}}}
    rig = camera(calibration=moved)
    p, q = projections(FINE, COARSE)
    x = midway(1.0)
    seen, other = (p @ x)[:2] / (p @ x)[2], (q @ x)[:2] / (q @ x)[2]
    z = [
        float(one[2, 0] / one[3, 0])
        for shift in (-0.3, 0.3)
        for one in [cv2.triangulatePoints(p, q, seen[:, None], other[:, None] + [[shift], [0.0]])]
    ]
    noise, both = (float(one.depth_uncertainty(1.0)) for one in (camera(), rig))
    assert np.sqrt(both**2 - noise**2) == pytest.approx(abs(z[1] - z[0]) / 2.0, rel=2e-2)


@pytest.mark.parametrize(
    ("said", "says"),
    [
        ({"depth": {"disparity_error": "derived"}}, "can be derived only for two cameras alike"),
        (
            {"geometry": None, "baseline": "75 mm", "lenses": {"focal_length": "2 mm"}},
            "needs the focal lengths of both",
        ),
        (
            {"calibration": {"errors": {"right_focal_length": {"standard_deviation": "1 um"}}}},
            "different pixels; give this error in px",
        ),
    ],
)
def test_what_needs_equal_cameras_is_refused(said: dict[str, Any], says: str) -> None:
    with pytest.raises(TradestudyError, match=says):
        camera(**said)


def camchain(folder: Path, scale: int = 4) -> None:
    """Two cameras of Kalibr, reduced by a scale."""
    cameras = []
    for (columns, rows), f, (x, y) in (FINE, COARSE):
        small = [(one + 0.5) / scale - 0.5 for one in (x, y)]
        cameras.append(
            {
                "camera_model": "pinhole",
                "intrinsics": [f / scale, f / scale, *small],
                "distortion_model": "radtan",
                "distortion_coeffs": [-0.05, 0.02, 0.0, 0.0],
                "resolution": [columns // scale, rows // scale],
            }
        )
    pose = np.vstack([np.c_[cv2.Rodrigues(TURN)[0], MOVED], [0.0, 0.0, 0.0, 1.0]])
    lines = [f"cam0: {json.dumps(cameras[0])}", f"cam1: {json.dumps({**cameras[1], 'T_cn_cnm1': pose.tolist()})}"]
    (folder / "chain.yaml").write_text("\n".join(lines))


def test_a_chain_of_two_sizes_is_read_and_written(tmp_path: Path) -> None:
    camchain(tmp_path)
    path = study(tmp_path, rig="from: chain.yaml")
    loaded = tradestudy.load(path)
    assert "; 480 × 270 px; right pictures 160 × 100 px; " in loaded.imported[0]
    found = export(loaded.prepared, "rig", ["kalibr", "mrcal"], lossy=False).texts
    for name, text in found.items():
        (tmp_path / name).write_text(text)
    files = [name for name in found if name.endswith("cameramodel")]
    for rig in (f"from: [{', '.join(sorted(files))}]", f"from: {next(one for one in found if one not in files)}"):
        other = study(tmp_path, rig=rig)
        np.testing.assert_allclose(calibrated(other).parameters, calibrated(path).parameters, rtol=1e-12, atol=1e-14)
        assert "right pictures 160 × 100 px" in tradestudy.load(other).imported[0]
    for word in ("opencv", "ros"):
        with pytest.raises(ExportError, match=r"pictures of two sizes(.|\n)*choose --format"):
            export(loaded.prepared, "rig", [word], lossy=False)
    wrong = study(tmp_path, rig="from: chain.yaml, right_sensor: {pixels: [320, 200]}")
    assert "is not the size of the calibrated right pictures, 160 × 100 px" in refusal(wrong)


HALF = np.array([[440.0, 0.0, 158.75], [0.0, 440.0, 120.25], [0.0, 0.0, 1.0]])
LISTS = {"K1": K1, "D1": L1, "K2": HALF, "D2": L2, "R": R, "T": T}
SIZES: dict[str, dict[str, Any]] = {
    "of each side": {"image_size_left": [640, 480], "image_size_right": [320, 240]},
    "by number": {"imageSize1": [640, 480], "imageSize2": [320, 240]},
    "width and height": {"image_width_1": 640, "image_height_1": 480, "width_2": 320, "height_2": 240},
}


def lists(folder: Path, says: dict[str, Any]) -> Path:
    text = json.dumps({**LISTS, **says}, default=lambda value: value.tolist())
    (folder / "lists.json").write_text(text)
    return study(folder, rig="from: lists.json, length_unit: m")


@pytest.mark.parametrize("name", SIZES)
def test_lists_may_give_a_size_of_each_picture(name: str, tmp_path: Path) -> None:
    loaded = tradestudy.load(lists(tmp_path, SIZES[name]))
    assert "; 640 × 480 px; right pictures 320 × 240 px; " in loaded.imported[0]
    assert "not used" not in loaded.imported[0]
    assert loaded.cameras["rig"]._calibrated.right_pixels == (320, 240)


def test_a_size_of_one_picture_is_doubted_for_another(tmp_path: Path) -> None:
    doubt = said_by(lists(tmp_path, {"image_size_left": [640, 480]}))["principal point"]
    assert doubt.startswith("camera 2: the principal point (158.75, 120.25) px lies far from the middle")
    said = refusal(lists(tmp_path, {"image_size": [640, 480], "image_size_right": [320, 240]}))
    assert "320 × 240 px contradicts the size that is read, 640 × 480 px" in said


def test_streams_of_a_realsense_may_have_two_sizes(tmp_path: Path) -> None:
    """A colour stream beside an infrared one."""
    says = everybody.realsense(tmp_path)
    file = tmp_path / "realsense.json"
    found = json.loads(file.read_text().replace("infrared2", "color"))
    found["color"] |= {"fx": 440.0, "fy": 440.0, "ppx": 158.75, "ppy": 120.25, "width": 320, "height": 240}
    file.write_text(json.dumps(found))
    (line,) = tradestudy.load(study(tmp_path, rig=f"{says}, pair: [infrared1, color]")).imported
    assert "; 640 × 480 px; right pictures 320 × 240 px; " in line
    assert "; infrared1 is left, color right; " in line


def test_depth_is_measured_in_their_pictures(tmp_path: Path) -> None:
    camchain(tmp_path)
    text = (Path(__file__).parents[1] / "data/render-imported/pp.yaml").read_text(encoding="utf-8")
    text = text.replace("from: pp.yml\n    length_unit: mm", "from: chain.yaml")
    (tmp_path / "pp.yaml").write_text(text, encoding="utf-8")
    api.render(api.load(tmp_path / "pp.yaml"), tmp_path, depth=True)
    folder = tmp_path / "pictures" / "rig"
    sizes = [cv2.imread(str(folder / f"{side}.png"), cv2.IMREAD_UNCHANGED).shape for side in ("left", "right")]
    assert sizes == [(270, 480), (100, 160)]
    score = json.loads((folder / "depth_map.json").read_text(encoding="utf-8"))["score"]
    assert abs(score["bias_px"]) < 0.05
    assert score["spread_px"] < 0.1
    assert score["filled"] > 0.9
