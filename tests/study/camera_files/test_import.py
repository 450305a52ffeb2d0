"""Calibration files of other programs: the same rig from every one, and a place for every mistake."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest

import tradestudy
from tests.data import simulate_corners
from tests.study.camera_files import written
from tests.study.camera_files.written import D1, D2, K1, K2, SIZE, R, T, study
from tradestudy.calibration.projection import move, project
from tradestudy.calibration.synthetic_target import faces, flat_grid
from tradestudy.cameras.calibrated_pair import CalibratedPair
from tradestudy.cameras.imported import ImportedRig
from tradestudy.cameras.stereo.declaration import StereoDeclaration
from tradestudy.cameras.stereo.design import StereoRig
from tradestudy.declarations.quantities import InPixels
from tradestudy.errors import StudyError
from tradestudy.optics.lens_families import DoubleSphere, KannalaBrandt
from tradestudy.optics.lens_model import Rational
from tradestudy.study.camera_files import kalibr
from tradestudy.study.camera_files.importing import recognised
from tradestudy.study.camera_files.located import CameraFileError, Request

ERRORS = "calibration: {errors: {yaw: {standard_deviation: 0.02 deg}, baseline: {standard_deviation: 0.1 mm}}}"


def shared(path: Path, name: str = "rig") -> np.ndarray:
    """The 18 parameters of a pair without distortion beyond k1 and k2."""
    pair = calibrated(path, name)
    for lens in pair.lenses:
        coefficients = lens.coefficients()
        assert not any(value for key, value in coefficients.items() if key not in pair.free)
    return np.array(pair.parameters)


def calibrated(path: Path, name: str = "rig") -> CalibratedPair:
    """What depth is read with."""
    rig = tradestudy.load(path).definition.designs[name]
    assert isinstance(rig, StereoRig)
    assert rig.calibrated_pair is not None
    return rig.calibrated_pair


def expected() -> np.ndarray:
    cameras = [[k[0, 0], k[1, 1], k[0, 2], k[1, 2], *d[:2]] for k, d in ((K1, D1), (K2, D2))]
    return np.array([*cameras[0], *cameras[1], *cv2.Rodrigues(R)[0].ravel(), *T])


def refusal(path: Path) -> str:
    with pytest.raises(StudyError) as caught:
        tradestudy.load(path)
    return str(caught.value)


@pytest.mark.parametrize("suffix", ["yml", "xml", "json"])
def test_opencv_writes_it_and_it_is_read_with_every_bit(tmp_path: Path, suffix: str) -> None:
    written.opencv(tmp_path / f"rig.{suffix}")
    found = shared(study(tmp_path, rig=f"from: rig.{suffix}, length_unit: mm"))
    np.testing.assert_allclose(found, expected(), rtol=1e-14, atol=1e-15)


def test_the_rectifying_rotations_of_ros_give_the_raw_pair_back(tmp_path: Path) -> None:
    written.camera_info_pair(tmp_path)
    found = shared(study(tmp_path, rig="from: [left.yaml, right.yaml]"))
    np.testing.assert_allclose(found, expected(), rtol=1e-11, atol=1e-13)


def test_opencv_ros_and_kalibr_give_the_same_depth_uncertainty(tmp_path: Path) -> None:
    written.opencv(tmp_path / "rig.yml")
    written.camera_info_pair(tmp_path)
    written.camchain(tmp_path / "chain.yaml")
    path = study(
        tmp_path,
        opencv=f"from: rig.yml, length_unit: mm, {ERRORS}",
        ros=f"from: [left.yaml, right.yaml], {ERRORS}",
        kalibr=f"from: chain.yaml, {ERRORS}",
    )
    loaded = tradestudy.load(path)
    opencv, *others = (
        loaded.cameras[name].depth_uncertainty(loaded.prepared.case.distance).values
        for name in ("opencv", "ros", "kalibr")
    )
    assert np.all(opencv > 0.0)
    for other in others:
        np.testing.assert_allclose(other, opencv, rtol=1e-9)


def test_two_camera_files_and_their_extrinsics_make_a_pair(tmp_path: Path) -> None:
    def one(name: str, **values: np.ndarray) -> None:
        storage = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_WRITE)
        for key, value in values.items():
            storage.write(key, value)
        storage.write("image_width", SIZE[0])
        storage.write("image_height", SIZE[1])
        storage.release()

    one("left.yml", camera_matrix=K1, distortion_coefficients=D1[:4])
    one("right.yml", camera_matrix=K2, distortion_coefficients=D2[:4])
    one("both.yml", R=R, T=T)
    found = shared(study(tmp_path, rig="from: [left.yml, right.yml, both.yml], length_unit: m"))
    np.testing.assert_allclose(found, expected(), rtol=1e-14, atol=1e-15)


def test_an_unknown_pair_is_refused_with_the_expected_keys(tmp_path: Path) -> None:
    storage = cv2.FileStorage(str(tmp_path / "rig.yml"), cv2.FILE_STORAGE_WRITE)
    for key, value in {"gridL": K1, "bendL": D1, "gridR": K2, "bendR": D2, "R": R, "T": T}.items():
        storage.write(key, value)
    storage.release()
    said = refusal(study(tmp_path, rig="from: rig.yml, length_unit: m"))
    assert "M1 and M2, or camera_matrix" in said
    assert "the file has gridL, bendL, gridR, bendR, R, T" in said


def test_cameras_numbered_from_zero_are_refused(tmp_path: Path) -> None:
    file = written.opencv(tmp_path / "rig.yml")
    text = file.read_text(encoding="utf-8")
    for one, other in (("M1:", "M0:"), ("M2:", "M1:"), ("D1:", "D0:"), ("D2:", "D1:")):
        text = text.replace(one, other)
    file.write_text(text, encoding="utf-8")
    said = refusal(study(tmp_path, rig="from: rig.yml, length_unit: mm"))
    assert "M0: the cameras are numbered 0 and 1; number them 1 and 2" in said


def test_a_pair_of_which_one_camera_has_no_distortion_is_refused(tmp_path: Path) -> None:
    file = written.opencv(tmp_path / "rig.yml")
    file.write_text(file.read_text(encoding="utf-8").replace("D1:", "lens1:"), encoding="utf-8")
    said = refusal(study(tmp_path, rig="from: rig.yml, length_unit: m"))
    assert "D2" in said
    assert "camera 1 has none" in said
    file.write_text(file.read_text(encoding="utf-8").replace("D2:", "lens2:"), encoding="utf-8")
    assert "lens1 is as long as distortion" in refusal(study(tmp_path, rig="from: rig.yml, length_unit: mm"))
    written.opencv(file, D1=np.zeros((1, 4)), D2=np.zeros((1, 4)))
    text = re.sub(r"D\d: !!opencv-matrix\n(   .*\n)*", "", file.read_text(encoding="utf-8"))
    file.write_text(text, encoding="utf-8")
    read = tradestudy.load(study(tmp_path, rig="from: rig.yml, length_unit: mm")).imported
    assert "distortion: none is given" in " ".join(read)


def test_a_lens_that_folds_before_the_edge_of_its_picture_is_warned_about(tmp_path: Path) -> None:
    """With k1 = -1.1 the law ρ + k1 ρ³ turns back at ρ = (-3 k1)^-1/2, 0.367 from the axis in the picture."""
    written.opencv(tmp_path / "rig.yml", D2=np.array([[-1.1, 0.0, 0.0, 0.0]]))
    (said,) = (one for one in tradestudy.load(study(tmp_path, rig="from: rig.yml, length_unit: mm")).warnings)
    x, y = np.meshgrid(np.arange(SIZE[0]), np.arange(SIZE[1]))
    beyond = np.mean(np.hypot((x - K2[0, 2]) / K2[0, 0], (y - K2[1, 2]) / K2[1, 1]) > 2.0 / 3.0 / np.sqrt(3.3))
    (share,) = re.findall(r"measured in ([0-9.]+) % of the picture of camera 2", said)
    assert float(share) / 100.0 == pytest.approx(beyond, abs=0.01)
    written.opencv(tmp_path / "rig.yml")
    assert not tradestudy.load(study(tmp_path, rig="from: rig.yml, length_unit: mm")).warnings


def test_a_vertical_pair_is_read_turned_and_sees_the_same_world(tmp_path: Path) -> None:
    """A point that OpenCV projects into both pictures is where the turned pair says, turned, whatever turns with it."""
    moved = np.array([0.0004, -0.07, 0.0011])
    turning = [1.5e-3, -2.5e-3, 0.01, 0.2, -0.03, 0.004, 1e-3, -2e-4, 3e-4, 4e-5]
    d1, d2 = np.append(D1[:2], turning), np.append(D2[:2], turning[::-1])
    written.opencv(tmp_path / "rig.yml", T=moved, D1=d1[None], D2=d2[None])
    found = calibrated(study(tmp_path, rig="from: rig.yml, length_unit: m"))
    from tradestudy.calibration.corners.real_rig import observe_pair

    point = np.array([[0.1, -0.05, 1.3]])
    upper = cv2.projectPoints(point, np.zeros(3), np.zeros(3), K1, d1)[0].ravel()
    lower = cv2.projectPoints(point, cv2.Rodrigues(R)[0], moved, K2, d2)[0].ravel()
    turned = point @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]).T
    columns = SIZE[0]
    np.testing.assert_allclose(
        observe_pair(np.array(found.parameters), turned, found.lenses)[0],
        [upper[1], columns - 1 - upper[0], lower[1], columns - 1 - lower[0]],
        atol=1e-9,
    )


def test_rectified_pictures_have_no_distortion(tmp_path: Path) -> None:
    _, _, p1, p2 = written.rectified()
    lens = np.array([[-0.25, 0.125, 0.001, -0.002, 0.01]])
    written.opencv(tmp_path / "rig.yml", D1=lens, D2=lens, P1=p1, P2=p2 * np.array([1.0, 1.0, 1.0, 1e3]))
    found = shared(study(tmp_path, rig="from: rig.yml, length_unit: mm, pictures: rectified"))
    np.testing.assert_allclose(found[[0, 1, 6, 7]], p1[0, 0], rtol=1e-14)
    np.testing.assert_allclose(found[12:], [0, 0, 0, -np.linalg.norm(T), 0, 0], atol=1e-12)
    written.opencv(tmp_path / "rig.yml", D1=lens, D2=lens)
    said = refusal(study(tmp_path, rig="from: rig.yml, length_unit: mm, pictures: rectified"))
    assert all(word in said for word in ("rectified", "P1", "P2", "stereoRectify"))
    told = "from: rig.yml, length_unit: mm, pictures: rectified, lens_model: fisheye"
    assert "lens_model does not apply to rectified pictures" in refusal(study(tmp_path, rig=told))


@pytest.mark.parametrize(
    ("stated", "told", "says"),
    [
        ("distortion_model: plumb_bob", "", "'plumb_bob' contradicts fisheye_model: 1"),
        (
            "camera_model: pinhole",
            ", lens_model: pinhole",
            "fisheye_model: 1 contradicts lens_model: pinhole of the study",
        ),
    ],
)
def test_two_statements_on_a_lens_must_agree(tmp_path: Path, stated: str, told: str, says: str) -> None:
    written.opencv(tmp_path / "rig.yml", D1=np.full((1, 4), 0.01), D2=np.full((1, 4), 0.01))
    with (tmp_path / "rig.yml").open("a", encoding="utf-8") as file:
        file.write(f"fisheye_model: 1\n{stated}\n")
    assert says in refusal(study(tmp_path, rig=f"from: rig.yml, length_unit: mm{told}"))


@pytest.mark.parametrize(
    ("flag", "lens"),
    [
        *((f"fisheye: {flag}", KannalaBrandt) for flag in ("yes", "On", "1.", "1.0", "true")),
        *((f"fisheye_model: {flag}", KannalaBrandt) for flag in ("equidistant", "kannala_brandt")),
        *((f"fisheye_model: {flag}", Rational) for flag in ("no", "off", "0", "0.", "0.0", "False", "pinhole")),
    ],
)
def test_a_flag_of_a_fisheye_lens_is_read_in_every_spelling(tmp_path: Path, flag: str, lens: type) -> None:
    file = written.opencv(tmp_path / "rig.yml", D1=np.full((1, 4), 0.01), D2=np.full((1, 4), 0.01))
    path, text = study(tmp_path, rig="from: rig.yml, length_unit: mm"), file.read_text()
    file.write_text(f"{text}{flag}\n")
    assert {type(one) for one in calibrated(path).lenses} == {lens}
    file.write_text(f"{text}fisheye_model: omni\n")
    assert "fisheye_model: 'omni' is unknown; one of 1, true, yes, on, 0, false, no, off, fisheye" in refusal(path)


def test_the_register_lists_how_the_file_was_read(tmp_path: Path) -> None:
    written.camchain(tmp_path / "chain.yaml")
    loaded = tradestudy.load(study(tmp_path, rig="from: chain.yaml"))
    register = loaded.run().data["assumptions"]
    rows = dict(
        zip(register["path"].values, zip(register["value"].values, register["note"].values, strict=True), strict=True)
    )
    assert rows["read_as.direction of transforms"][0].startswith("T_cn_cnm1 maps camera n − 1 into camera n")
    assert rows["read_as.direction of transforms"][1] == "chain.yaml: cam1.T_cn_cnm1"
    assert rows["read_as.origin of pixels"][0].startswith("the centre of the first pixel is (0, 0)")
    assert rows["read_as.pictures"][0].startswith("raw")
    assert rows["read_as.order of cameras"][0] == "cam0 is left, cam1 right"
    assert rows["read_as.length unit"][0] == "m, by the definition of Kalibr's camchain"
    assert rows["geometry.left.focal_length"] == ("[882.5 px, 881.75 px]", "chain.yaml: cam0.intrinsics")
    assert rows["depth.disparity_error"][1] == "default; the study declares none"
    assert loaded.imported[0].startswith(
        "rig: chain.yaml: Kalibr camchain; lens model pinhole with k1 k2; field of view"
    )
    assert all(
        f"; {one}; " in loaded.imported[0]
        for one in ("baseline 60.1 mm", "640 × 480 px", "length unit m, by the definition of Kalibr's camchain")
    )
    assert loaded.imported[0].endswith("; not used: cam0.rostopic, cam1.rostopic")


@pytest.mark.parametrize(
    ("turned", "says"),
    [
        ((0.0, 0.0, 90.0), "rotated by 90° about its viewing axis"),
        ((0.0, 0.0, -180.0), "rotated by 180° about its viewing axis"),
        ((0.0, 180.0, 0.0), "180° apart"),
        ((0.0, -100.0, 10.0), "100° apart"),
    ],
)
@pytest.mark.parametrize("side", [60.0, -60.0])
def test_a_camera_upside_down_or_backwards_is_refused(tmp_path, turned, says, side):
    """The camera stands truly to the right or left: exchanging the cameras would not help."""
    rotation = cv2.Rodrigues(np.radians(turned))[0]
    written.opencv(tmp_path / "rig.yml", R=rotation, T=-rotation @ np.array([[side], [0.0], [0.0]]))
    with pytest.raises(StudyError, match=says):
        calibrated(study(tmp_path, rig="from: rig.yml, length_unit: mm"))


def test_a_strong_toe_in_is_imported(tmp_path):
    rotation = cv2.Rodrigues(np.radians([0.0, -40.0, 0.0]))[0]
    written.opencv(tmp_path / "rig.yml", R=rotation, T=-rotation @ np.array([[60.0], [0.0], [0.0]]))
    angle = shared(study(tmp_path, rig="from: rig.yml, length_unit: mm"))[12:15]
    np.testing.assert_allclose(np.degrees(angle), [0.0, -40.0, 0.0], atol=1e-9)


def test_corners_on_a_board_in_a_wrong_unit_are_refused(tmp_path):
    rows = simulate_corners.FILE.read_text().splitlines()
    text = "\n".join([rows[0], *(row for row in rows[1:] if int(row.split(",")[0]) % 3 == 0)]) + "\n"
    (tmp_path / "corners.csv").write_text(text.replace("board_x_mm", "board_x_m").replace("board_y_mm", "board_y_m"))
    with pytest.raises(StudyError, match="20 m is expected; name the columns board_x_mm"):
        tradestudy.load(study(tmp_path, rig="from: corners.csv, sensor: {pixels: [1024, 1024]}"))


MISTAKES = {
    "unit": ("from: rig.yml", ("length_unit: mm",)),
    "metres": ("from: rig.yml, length_unit: m", ("60.1 m,", "60.1 mm with length_unit: mm", "length_unit: cm")),
    "millimetres": ("from: chain.yaml, length_unit: mm", ("60.1 µm,", "length_unit: m ")),
    "exchanged": ("from: chain.yaml, pair: [cam1, cam0]", ("cam0", "60.1 mm", "left of cam1", "pair:")),
    "files exchanged": ("from: [right.yaml, left.yaml]", ("P[3]", "list left first in from:")),
    "no baseline": ("from: [left.yaml, left.yaml]", ("P[3] and P[7]", "0")),
    "another camera": ("from: chain.yaml, pair: [cam0, cam7]", ("'cam7'", "cam0, cam1")),
    "mixed": ("from: [left.yaml, rig.yml]", ("OpenCV FileStorage", "ROS camera_info")),
    "unit that is none": ("from: rig.yml, length_unit: furlong", ("'furlong'",)),
    "an option of another format": ("from: chain.yaml, pictures: rectified", ("pictures", "Kalibr camchain")),
    "given twice": ("from: chain.yaml, baseline: 60 mm", ("cameras.rig.baseline", "geometry: null")),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_mix_ups_are_named_at_their_place(tmp_path: Path, name: str) -> None:
    written.opencv(tmp_path / "rig.yml")
    written.camera_info_pair(tmp_path)
    written.camchain(tmp_path / "chain.yaml")
    said, facts = MISTAKES[name]
    message = refusal(study(tmp_path, rig=said))
    assert [fact for fact in facts if fact not in message] == []
    file, line, column, path = message.split(":")[:4]
    assert Path(file).parent == tmp_path
    assert int(line) >= 1
    assert int(column) >= 1
    assert path.strip().startswith("cameras.rig")


def test_a_projection_matrix_whose_baseline_overflows_is_refused(tmp_path: Path) -> None:
    left, right = written.camera_info_pair(tmp_path)
    text = right.read_text(encoding="utf-8")
    focal_length = text.split("projection_matrix:")[1].split("[")[1].split(",")[0]
    right.write_text(text.replace(f"[{focal_length},", "[1e-320,"), encoding="utf-8")
    message = refusal(study(tmp_path, rig=f"from: [{left.name}, {right.name}]"))
    assert all(word in message for word in ("right.yaml", "P[3]", "too large for the focal length"))


def test_a_pinhole_that_shows_no_angles_is_refused(tmp_path: Path) -> None:
    text = written.camchain(tmp_path / "chain.yaml").read_text(encoding="utf-8")
    (tmp_path / "chain.yaml").write_text(text.replace("[882.5,", "[1.0e-308,"), encoding="utf-8")
    message = refusal(study(tmp_path, rig="from: chain.yaml"))
    assert all(word in message for word in ("cam0.intrinsics", "1e-308, 881.75, 320.125", "1e-12 px or more"))


@pytest.mark.parametrize(
    ("lengths", "unit", "reported"),
    [
        (1.0, "cm", "601 µm, but 60.1 mm with length_unit: m beside from:"),
        (1e2, "m", "6.01 m, but 60.1 mm with length_unit: cm beside from:"),
        (1e2, "mm", "6.01 mm, but 60.1 mm with length_unit: cm beside from:"),
        (1e3, "mm", ""),
        (1e3, "cm", ""),  # 601 mm, as usual as 60.1 mm
    ],
)
def test_a_baseline_that_would_be_usual_in_another_unit_is_warned_about(
    tmp_path: Path, lengths: float, unit: str, reported: str
) -> None:
    written.opencv(tmp_path / "rig.yml", lengths=lengths)
    warned = tradestudy.load(study(tmp_path, rig=f"from: rig.yml, length_unit: {unit}")).warnings
    squares = "; or, if T counts squares of the board, multiply T by their side"
    said = [str(one).partition("the baseline is ")[2] for one in warned if "baseline" in str(one)]
    assert said == ([reported + squares] if reported else [])
    assert all("cameras.rig.from" in str(one) for one in warned if "baseline" in str(one))


def test_a_fisheye_lens_under_the_name_of_a_pinhole_one_is_named(tmp_path: Path) -> None:
    r1, r2, p1, p2 = written.rectified()
    fisheye = np.array([-0.03, 0.11, -0.12, 0.04, 0.0])
    written.camera_info(tmp_path / "left.yaml", K1, fisheye, r1, p1)
    written.camera_info(tmp_path / "right.yaml", K2, fisheye, r2, p2)
    message = refusal(study(tmp_path, rig="from: [left.yaml, right.yaml]"))
    assert all(word in message for word in ("p1 = -0.12", "0.05", "name the model equidistant in the file"))


def test_a_calibrated_pair_without_errors_reads_depth_exactly(tmp_path: Path) -> None:
    """What the geometry puts into the pictures, it reads back: 1/Z to rounding."""
    written.opencv(tmp_path / "rig.yml")
    camera = tradestudy.load(study(tmp_path, rig="from: rig.yml, length_unit: mm")).prepared.case.cameras["rig"]
    assert camera.calibration.measurement is not None
    distance = np.geomspace(0.3, 5.0, 7)
    read = camera.calibration.measurement(distance, 0.3, {"yaw": np.zeros((1, 1))}, None)
    np.testing.assert_allclose(read.inverse_depth[0] * distance, 1.0, atol=1e-9)


def test_a_corner_file_gives_the_design_that_its_fit_finds(tmp_path: Path) -> None:
    """Of simulated corners, whose generator knows the truth."""
    (tmp_path / "corners.csv").write_bytes(simulate_corners.FILE.read_bytes())
    loaded = tradestudy.load(study(tmp_path, rig="from: corners.csv, sensor: {pixels: [1024, 1024]}"))
    assert "length unit mm, by the name of the column board_x_mm" in loaded.imported[0]
    part, true = loaded.file.cameras["rig"], simulate_corners.true_rig()
    assert isinstance(part, StereoDeclaration)
    assert part.baseline == pytest.approx(np.linalg.norm(true[15:18]), rel=5e-4)
    assert isinstance(part.lenses.focal_length, InPixels)
    assert part.lenses.focal_length.pixels == pytest.approx(true[[0, 1, 6, 7]].mean(), rel=1e-3)
    assert part.depth.disparity_error == pytest.approx(2**0.5 * simulate_corners.NOISE_PX, rel=0.03)
    assert loaded.definition.data_files == {"cameras.rig.calibration.corners.file": tmp_path / "corners.csv"}
    assert loaded.definition.calibrations_to_infer()


def test_corners_of_a_wide_lens_are_fitted_with_the_declared_lens_model(tmp_path: Path) -> None:
    """Directions up to 68° off the axis, which k1 and k2 cannot describe; the focal length is that on the axis."""
    lens, camera = DoubleSphere(xi=-0.15, alpha=0.58), np.array([205.0, 206.0, 322.0, 236.0])
    relative, grid = np.array([0.004, -0.006, 0.003, -0.08, 1e-3, -2e-3]), flat_grid(9, 6, 0.024)
    rng, rows = np.random.default_rng(1), []
    while len(rows) < 16 * len(grid):
        z = rng.uniform(0.07, 0.3)
        pose = np.array([*(0.35 * rng.standard_normal(3)), *(rng.uniform(-2.5, 2.5, 2) * z), z])
        points = move(pose, grid)
        seen = np.hstack([project(camera, points, lens, ()), project(camera, move(relative, points), lens, ())])
        if faces(pose[None])[0] and np.all((seen > 2.0) & (seen < [637.0, 477.0] * 2)):
            view = np.full((len(grid), 1), len(rows) // len(grid))
            seen = seen + 0.1 * rng.standard_normal(seen.shape)
            rows += np.hstack([view, np.arange(len(grid))[:, None], 1e3 * grid[:, :2], seen]).tolist()
    head = "view,corner,board_x_mm,board_y_mm,left_x_px,left_y_px,right_x_px,right_y_px"
    np.savetxt(tmp_path / "corners.csv", rows, fmt=["%d", "%d", *["%.5f"] * 6], delimiter=",", header=head, comments="")
    with pytest.raises(StudyError, match=r"corners\.csv"):  # the default model cannot describe them
        tradestudy.load(study(tmp_path, rig="from: corners.csv, sensor: {pixels: [640, 480]}"))
    fitted = "calibration: {corners: {lens_model: {model: double-sphere}}}"
    part = tradestudy.load(
        study(tmp_path, rig=f"from: corners.csv, sensor: {{pixels: [640, 480]}}, {fitted}")
    ).file.cameras["rig"]
    assert isinstance(part, StereoDeclaration)
    assert isinstance(part.lenses.focal_length, InPixels)
    assert part.baseline == pytest.approx(np.linalg.norm(relative[3:]), rel=3e-3)
    slope = 1e-6
    on_axis = project(camera, np.array([[slope, 0.0, 1.0]]), lens, ())[0, 0] - camera[2]
    assert part.lenses.focal_length.pixels == pytest.approx(on_axis / slope, rel=5e-3)
    assert part.depth.disparity_error == pytest.approx(2**0.5 * 0.1, rel=0.05)


def test_corners_that_scatter_more_than_any_detector_cause_a_warning(tmp_path: Path) -> None:
    head, *rows = simulate_corners.FILE.read_text().splitlines()
    rows = [row for row in rows if int(row.split(",")[0]) % 3 == 0]
    table = np.array([row.split(",") for row in rows], dtype=float)
    table[:, 4:] += 0.8 * np.random.default_rng(0).standard_normal(table[:, 4:].shape)
    np.savetxt(
        tmp_path / "corners.csv", table, fmt=["%d", "%d", *["%.5f"] * 6], delimiter=",", header=head, comments=""
    )
    loaded = tradestudy.load(study(tmp_path, rig="from: corners.csv, sensor: {pixels: [1024, 1024]}"))
    (warning,) = [str(one) for one in loaded.warnings if "scatter" in str(one)]
    assert re.search(r"cameras\.rig\.from: .* scatter by 0\.8\d? px.* rational with k1 k2", warning)
    (tmp_path / "corners.csv").write_text("\n".join([head, *rows]) + "\n")
    quiet = tradestudy.load(study(tmp_path, rig="from: corners.csv, sensor: {pixels: [1024, 1024]}"))
    assert not any("scatter" in str(one) or "principal point" in str(one) for one in quiet.warnings)
    large = tradestudy.load(study(tmp_path, rig="from: corners.csv, sensor: {pixels: [2048, 2048]}"))
    (off,) = [str(one) for one in large.warnings if "principal point" in str(one)]
    assert "left and right: the principal points (5" in off
    assert off.count("another resolution") == 1


def test_a_vertical_pair_of_ros_is_that_of_opencv(tmp_path: Path) -> None:
    moved = np.array([0.0004, -0.07, 0.0011])
    written.opencv(tmp_path / "rig.yml", T=moved[:, None])
    r1, r2, p1, p2 = cv2.stereoRectify(K1, D1, K2, D2, SIZE, R, moved[:, None], flags=cv2.CALIB_ZERO_DISPARITY)[:4]
    assert p2[1, 3] < 0.0 == p2[0, 3]
    written.camera_info(tmp_path / "upper.yaml", K1, D1, r1, p1)
    written.camera_info(tmp_path / "lower.yaml", K2, D2, r2, p2)
    found = shared(study(tmp_path, rig="from: [upper.yaml, lower.yaml]"))
    np.testing.assert_allclose(
        found, shared(study(tmp_path, rig="from: rig.yml, length_unit: m")), rtol=1e-10, atol=1e-12
    )


@pytest.mark.parametrize(
    ("camera_model", "own", "coefficients"),
    [
        ("omni", [1.25], {"xi": 1.25, "k1": -0.1, "k2": 0.02, "p1": 3e-4, "p2": -4e-4}),
        ("ds", [-0.2, 0.59], {"xi": -0.2, "alpha": 0.59}),
        ("eucm", [0.6, 1.1], {"alpha": 0.6, "beta": 1.1}),
    ],
)
def test_models_of_kalibr_have_their_own_numbers_first(
    tmp_path: Path, camera_model: str, own: list[float], coefficients: dict[str, float]
) -> None:
    lens = {"distortion_model": "none", "distortion_coeffs": []}
    if camera_model == "omni":
        lens = {"distortion_model": "radtan", "distortion_coeffs": [-0.1, 0.02, 3e-4, -4e-4]}
    path = written.camchain(
        tmp_path / "chain.yaml", camera_model=camera_model, intrinsics=[*own, 400.0, 401.0, 320.0, 240.0], **lens
    )
    file = recognised(path, path.read_text(), path.name)
    assert file is not None
    rig = kalibr.FORMAT.read([file], Request())
    assert isinstance(rig, ImportedRig)
    assert rig.left.coefficients == coefficients
    assert (rig.left.focal_lengths, rig.left.centre) == ((400.0, 401.0), (320.0, 240.0))
    for asked in ("pinhole", "fisheye"):
        with pytest.raises(CameraFileError, match=f"{camera_model} includes its own lens model; remove .*: {asked}"):
            kalibr.FORMAT.read([file], Request(lens_model=asked))


@pytest.mark.parametrize("order", [(0, 1, 2, 3, 10), (0, 2, 1, 10, 3), (0, 1, 10, 2, 3)])
def test_chains_follow_the_numbers_of_cameras_in_any_order(tmp_path: Path, order: tuple[int, ...]) -> None:
    """Camera n lies 10 n mm to the right of camera n − 1."""

    def baseline(numbers: Sequence[int], *pair: str) -> float:
        cameras = {
            f"cam{n}": {
                "camera_model": "pinhole",
                "intrinsics": [900.0, 900.0, 320.0, 240.0],
                "distortion_model": "radtan",
                "distortion_coeffs": [0.0] * 4,
                "resolution": [640, 480],
                "T_cn_cnm1": [[1, 0, 0, -0.01 * n], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
            }
            for n in numbers
        }
        del cameras["cam0"]["T_cn_cnm1"]
        path = tmp_path / "chain.yaml"
        path.write_text("\n".join(f"{name}: {json.dumps(camera)}" for name, camera in cameras.items()))
        file = recognised(path, path.read_text(), path.name)
        assert file is not None
        rig = kalibr.FORMAT.read([file], Request(pair=pair))
        assert isinstance(rig, ImportedRig)
        return float(np.linalg.norm(rig.translation))

    assert baseline(order) == pytest.approx(0.01)
    assert baseline(order, "cam1", "cam2") == pytest.approx(0.02)
    assert baseline(order, "cam0", "cam3") == pytest.approx(0.06)
    for numbers, pair in ((order, ("cam3", "cam10")), (order, ("cam1", "cam10"))):
        with pytest.raises(CameraFileError, match="cam10 leads from cam9, which the file lacks; give the whole chain"):
            baseline(numbers, *pair)
    with pytest.raises(CameraFileError, match="cam2 leads from cam1, which the file lacks"):
        baseline([n for n in order if n != 1])


def test_the_design_of_a_converging_pair_converges_with_it(tmp_path: Path) -> None:
    """The right camera looks to the left by 10°; in its frame a point of the left axis moves to the right."""
    angle = np.radians(10.0)
    turn = np.array([[np.cos(angle), 0.0, np.sin(angle)], [0.0, 1.0, 0.0], [-np.sin(angle), 0.0, np.cos(angle)]])
    written.opencv(tmp_path / "rig.yml", R=turn, T=turn @ np.array([[-60.0], [0.0], [0.0]]))
    rig = tradestudy.load(study(tmp_path, rig="from: rig.yml, length_unit: mm")).definition.designs["rig"]
    assert isinstance(rig, StereoRig)
    assert rig.convergence_angle == pytest.approx(angle, rel=1e-12)
    assert rig.separation == pytest.approx(0.06, rel=1e-12)


def test_two_files_of_one_name_are_distinguished(tmp_path: Path) -> None:
    r1, r2, p1, p2 = written.rectified()
    for folder, files in (("left", (K1, D1, r1, p1)), ("right", (K2, D2, r2, p2))):
        (tmp_path / folder).mkdir()
        written.camera_info(tmp_path / folder / "ost.yaml", *files)
    loaded = tradestudy.load(study(tmp_path, rig="from: [left/ost.yaml, right/ost.yaml]"))
    for side in ("left", "right"):
        path = ("cameras", "rig", "geometry", side, "focal_length")
        assert loaded.definition.document.locate(path).file == str(tmp_path / side / "ost.yaml")
        assert loaded.definition.document.annotations[path].note == f"{side}/ost.yaml: camera_matrix"


def test_rigs_that_differ_from_distance_to_distance_are_read_one_by_one(tmp_path: Path) -> None:
    written.opencv(tmp_path / "rig.yml")
    camera = tradestudy.load(study(tmp_path, rig="from: rig.yml, length_unit: mm")).prepared.case.cameras["rig"]
    measurement, distance = camera.calibration.measurement, np.array([0.4, 1.0, 3.0])
    assert measurement is not None
    yaw = np.radians([[0.01, -0.02, 0.005], [0.0, 0.03, -0.01]])
    together = measurement(distance, 0.0, {"yaw": yaw}, None).inverse_depth
    apart = [
        measurement(distance[k : k + 1], 0.0, {"yaw": yaw[row, k].reshape(1, 1)}, None).inverse_depth.item()
        for row in range(2)
        for k in range(3)
    ]
    np.testing.assert_allclose(together.ravel(), apart, rtol=1e-14)


def test_pictures_of_a_part_of_the_sensor_are_refused(tmp_path: Path) -> None:
    """K and P of camera_info describe the whole sensor, but depth would be measured in fewer or larger pixels."""
    matrices = (K1, D1, np.eye(3), np.hstack([K1, np.zeros((3, 1))]))
    whole = {"x_offset": 0, "y_offset": 0, "width": SIZE[0], "height": SIZE[1], "do_rectify": False}
    said = "kind: conventional, from: left.yaml, sensor: {pixel_pitch: 3 um}, focus: {distance: 1 m}"
    camera = study(tmp_path, camera=said)
    for changed, words in (
        ({"binning_x": 2, "binning_y": 2}, "binned"),
        ({"roi": {**whole, "width": 100}}, "region of interest"),
        ({"roi": {**whole, "x_offset": 8}}, "region of interest"),
    ):
        written.camera_info(tmp_path / "left.yaml", *matrices, **changed)
        assert words in refusal(camera)
    written.camera_info(tmp_path / "left.yaml", *matrices, binning_x=1, binning_y=0, roi=whole)
    tradestudy.load(camera)


def test_a_rig_is_unusable_where_one_camera_does_not_see_the_point_whose_depth_it_measures(tmp_path: Path) -> None:
    """Principal points far to the right: near points before the middle of the rig leave one of the pictures."""
    k = np.array([[882.0, 0.0, 600.0], [0.0, 882.0, 240.0], [0.0, 0.0, 1.0]])
    written.opencv(tmp_path / "off.yml", M1=k, M2=k, D1=np.zeros((1, 5)), D2=np.zeros((1, 5)), R=np.eye(3))
    loaded = tradestudy.load(study(tmp_path, rig="from: off.yml, length_unit: mm"))
    depth = loaded.with_values({"scene.distances": {"from": "0.3 m", "to": "5 m", "points": 12}}).run().data["depth"]
    seen = np.isfinite(depth["depth_uncertainty"].values)
    assert seen.any()
    assert not seen.all()
    np.testing.assert_array_equal(depth["usable"].values.astype(bool), seen)


def test_an_error_that_leaves_no_camera_is_refused(tmp_path: Path) -> None:
    """A variance of 16 px², as calibration programs state it, read as 16 m²."""
    (tmp_path / "posterior.csv").write_text("parameter,mean,focal_length\nfocal_length,0,16\n")
    rig = (
        "kind: stereo, lenses: {focal_length: 882 px}, sensor: {pixels: [640, 480], pixel_pitch: 3 um}, baseline: 60 mm"
    )
    said = f"{rig}, depth: {{disparity_error: 0.2 px}}, calibration: {{posterior: {{file: posterior.csv}}}}"
    with pytest.raises(StudyError, match=r"deviation of focal_length .* 4 m, leaves no camera .* check its unit"):
        tradestudy.load(study(tmp_path, rig=said)).prepared.case  # noqa: B018 - building it is what refuses
