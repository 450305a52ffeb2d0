"""Keys beside those that a format needs: used, named as not used, or refused if they change what is read."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import tradestudy
from tests.study.camera_files import devices, written
from tests.study.camera_files.test_import import calibrated, refusal
from tests.study.camera_files.written import study
from tradestudy.study.plausibility import implausible

IN_MM = "from: rig.yml, length_unit: mm"
LENGTH = 1e3 * float(np.linalg.norm(written.T))  # mm


def with_lines(folder: Path, lines: str, said: str = IN_MM) -> Path:
    """A study of the OpenCV rig with more lines in its file."""
    file = written.opencv(folder / "rig.yml")
    file.write_text(f"{file.read_text()}{lines}\n")
    return study(folder, rig=said)


def unused(path: Path) -> str:
    """The keys that are named as not used; empty if there are none."""
    return tradestudy.load(path).imported[0].partition("; not used: ")[2]


@pytest.mark.parametrize(
    ("attribute", "said"),
    [
        (('<T type_id="opencv-matrix">', '<T type_id="opencv-matrix" unit="cm">'), "rig.T_unit: cm is not the unit in"),
        (("<opencv_storage>", '<opencv_storage unit="in">'), "rig.unit: in is not the unit in which lengths are read"),
        (("<T ", '<T scale="2" '), "rig.T_scale: this key looks like a scale"),
        (("<M1 ", '<M1 unit="mm" '), "rig.M1_unit: mm is not the unit in which this is read, px"),
        (("<D1 ", '<D1 model="equidistant" '), "contradicts the lens model that is read, pinhole"),
        (("<T ", '<T_unit>mm</T_unit><T unit="mm" '), "both called T_unit"),
        (("<rows>3</rows>", "mm<rows>3</rows>"), "elements, list elements (_) and text are mixed"),
    ],
)
def test_attributes_of_xml_are_treated_like_keys(tmp_path: Path, attribute: tuple[str, str], said: str) -> None:
    file = written.opencv(tmp_path / "rig.xml")
    file.write_text(file.read_text().replace(*attribute, 1))
    assert said in refusal(study(tmp_path, rig="from: rig.xml, length_unit: mm"))


def test_harmless_attributes_of_xml_are_used_or_named(tmp_path: Path) -> None:
    file = written.opencv(tmp_path / "rig.xml")
    before = calibrated(study(tmp_path, rig="from: rig.xml, length_unit: mm"))
    file.write_text(file.read_text().replace("<T ", '<T unit="mm" by="me" ', 1))
    path = study(tmp_path, rig="from: rig.xml")
    assert calibrated(path) == before
    assert "length unit mm, by T_unit of the file" in tradestudy.load(path).imported[0]
    assert unused(path) == "T_by"


@pytest.mark.parametrize(
    "line",
    [
        f"baseline: {LENGTH:.3f}",
        "baseline: 60",  # nominal
        f"stereo: {{baseline_m: {LENGTH / 1e3:.5f}}}",
        f"Baseline: {LENGTH:.2f} mm",
        "distortion_model1: plumb_bob\ndistortion_model2: plumb_bob",
        "T_scale: 1",
        "left_units: mm",
        "Unit: millimeters",
        "K_unit: px",
        "is_fisheye: false",
        "rvec: [0.004, -0.013, 0.0021]",
        "imageSize: [640, 480]",
        "camera1: left",
        f"P2: [880, 0, 320, {-880 * LENGTH}, 0, 880, 240, 0, 0, 0, 1, 0]",
        "fx1: 882.5",
        "fx_left: 882.5\nFX_RIGHT: 880.25",
        "fx_0: 882.5\nfx_1: 880.25",
        "left_cx: 320.125\nright: {cx: 318.5, cy: 241.25}",
        "right_principal_point: [318.5, 241.25]",
        "quaternion: [0.9999757, 0.002, -0.0064999, 0.00105]",  # cos and sin of half the angle; the real part first
        "calib_width: 640\ncalib_height: 480",
        "frame_size: {height: 480, width: 640}",
        "calibration_resolution: 640x480",
        "tvec: [-60.1, 0.2, 1.1]",
        "translation_mm: [-60, 0, 1]",
        "Tx: -60.1",
    ],
)
def test_second_values_that_agree_are_accepted(tmp_path: Path, line: str) -> None:
    path = with_lines(tmp_path, line)
    assert unused(path) in ("", "T_scale", "camera1")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("baseline: 120", "baseline: 120 mm contradicts the baseline that is read, 60.1 mm"),
        ("baseline: 0.0601", "60.1 µm contradicts the baseline"),
        ("rig: {baseline_mm: 65}", "rig.baseline_mm: 65 mm contradicts"),
        ("Tx: -120", "120 mm contradicts"),
        ("T_scale: 2.0", "this key looks like a scale"),
        ("scale_factor: 1000", "this key looks like a scale"),
        ("scaleOfLengths: 25", "this key looks like a scale"),
        ("translation_scale: half", "this key looks like a scale"),
        ("calibration: {length: {Unit: m}}", "m is not the unit in which lengths are read, mm"),
        ("meta: {units: {length: m}}", "m is not the unit in which lengths are read, mm"),
        ("left_camera: 2", "give pair: [2, 1] beside from: if camera 2 is the left one"),
        ("camera1: right", "give pair: [2, 1] beside from: if camera 2 is the left one"),
        ("alpha_c1: 0.01", "looks like a part of the lens model"),
        ("P2: [880, 0, 320, -105600, 0, 880, 240, 0, 0, 0, 1, 0]", "120 mm contradicts the baseline"),
        ("yaw_deg: 2", "contradicts the one that is read"),
        ("left_units: inches", "inches is not the unit"),
        ("T_unit: squares", "squares is not the unit"),
        ("T_unit: px", "px is not the unit"),
        ("angle_unit: deg", "deg is not the unit in which this is read, rad"),
        ("focal_unit: mm", "mm is not the unit in which this is read, px"),
        ("unit_of_length: 0.01", "0.01 is not the unit"),
        ("lens: {projection: equidistant}", "contradicts the lens model that is read, pinhole"),
        ("models: [pinhole, Kannala-Brandt]", "Kannala-Brandt contradicts the lens model"),
        ("is_fisheye: true", "true contradicts the lens model"),
        ("distortion_type: wavy", "the lens model 'wavy' is unknown"),
        ("rectified: true", "read as that of raw pictures"),
        ("images_undistorted: 1", "read as that of raw pictures"),
        ("rotation_of_pictures: 180", "looks like a change of the pictures"),
        ("flip: horizontal", "looks like a change of the pictures"),
        ("convention: camera to world", "looks like a convention"),
        ("matrices_transposed: 1", "looks like a convention"),
        ("pixel_origin: 1", "looks like a convention"),
        ("rvec: [0.23, -0.745, 0.12]", "contradicts the one that is read"),  # in degrees
        ("euler: {rotation: [0.1, 0.0, 0.0]}", "contradicts the one that is read"),
        ("imageSize: [1280, 960]", "contradicts the size that is read, 640 × 480 px"),
        ("calibration_resolution: [1280, 960]", "contradicts the size that is read"),
        ("coefficient_order: k1 k2 k3 p1 p2", "looks like a convention"),
        ("T_mm: [-65, 0, 0]", "65 mm contradicts"),
        ("R_deg: [1, 2, 3]", "contradicts the one that is read"),
        ("baseline: sixty", "'sixty' is not a length"),
        ("principal_point: [320.125, 20]", "20 contradicts the camera matrix"),
        ("half_resolution: true", "looks like a change of the pictures"),
        ("T_multiplier: 10", "looks like a scale"),
        ("fx1: 441.25", "contradicts the camera matrix that is read"),
        ("fx_left: 880.25", "880.25 contradicts the camera matrix that is read, 882.5 px of camera 1"),
        ("right: {fx: 882.5}", "882.5 contradicts the camera matrix that is read, 880.25 px of camera 2"),
        (
            "fx_0: 882.5\nfx_1: 882.5",
            "rig.fx_1: 882.5 contradicts the camera matrix that is read, 880.25 px of camera 2",
        ),
        ("R_CX: 320.125", "320.125 contradicts the camera matrix that is read, 318.5 px of camera 2"),
        ("cameras: [{fx: 882.5}, {fx: 882.5}]", "rig.cameras.1.fx: 882.5 contradicts"),
        (
            "cx: 882.5",
            "882.5 contradicts the camera matrix that is read, 320.125 px of camera 1 and 318.5 px of camera 2",
        ),
        ("principal_point_left: [239.5, 320.125]", "239.5 contradicts the camera matrix"),
        ("om: [-0.004, 0.013, -0.0021]", "the other way, like the inverse pose, contradicts the one that is read"),
        ("rvec: [0.01376, 0.0, 0.0]", "a rotation by 0.788° about another axis contradicts the one that is read"),
        ("rotation_vector_deg: [0.2292, 0.7448, 0.1203]", "about another axis contradicts"),
        ("quaternion: [0.9999757, -0.002, 0.0064999, -0.00105]", "the other way, like the inverse pose, contradicts"),
        ("tvec: [60.1, -0.2, -1.1]", "points the opposite way, like that of the inverse pose"),
        (
            "tvec: [0.0, 0.0, 60.1]",
            "(0 m, 0 m, 60.1 mm) contradicts the translation that is read, (−60.1 mm, 200 µm, 1.1 mm)",
        ),
        ("Tx: 60.1", "60.1 mm contradicts the translation that is read, −60.1 mm"),
        ("pose: {translation: {x: -60.1, y: 5.0, z: 1.1}}", "(−60.1 mm, 5 mm, 1.1 mm) contradicts the translation"),
        (f"P2: [880, 0, 320, {880 * LENGTH}, 0, 880, 240, 0, 0, 0, 1, 0]", "points the opposite way"),
        ("calib_width: 480", "a width of 480 px contradicts the size that is read, 640 × 480 px"),
        ("calib_height: 640", "a height of 640 px contradicts the size that is read"),
        ("frame_size: {height: 640, width: 480}", "480 × 640 px contradicts the size"),
        ("calibration_resolution: 480x640", "480 × 640 px contradicts the size"),
        ("tvec: [.nan, 0, 0]", "a number is not finite"),
        ("R_stereo: {rotation: [1, 0, 0, 0, .inf, 0, 0, 0, 1]}", "a number is not finite"),
        ("downsample: true", "looks like a scale of the pictures"),
        ("T_scaling: true", "looks like a scale"),
        ("T_scale: 640", "looks like a scale"),
        ("resize: [480, 640]", "looks like a scale of the pictures"),
        ("crop: true", "looks like a part of the picture"),
        ("crop: [0, 0, 480, 480]", "looks like a part of the picture"),
        ("x_offset: 640", "looks like a part of the picture"),
    ],
)
def test_keys_that_change_the_meaning_are_refused(tmp_path: Path, line: str, said: str) -> None:
    message = refusal(with_lines(tmp_path, line))
    assert said in message.replace("\N{NO-BREAK SPACE}", " ")
    assert "\n" not in message


@pytest.mark.parametrize(
    "line",
    [
        "baseline_uncertainty: 0.1",
        "time_unit: s",
        "rotation_error: 0.1",
        "unit_serial: A17",
        "camera: D435",
        "rms_unit: px",
        "note: fisheye rig",
        "square_size: 25",
        "timeshift: 0.01",
        "left_camera: 1",
        "yaw_deg: -0.745",  # angles whose order is unknown
        "euler_deg: [0.2292, -0.7448, 0.1203]",
        "pose: {rotation: [0.004, -0.013, 0.0021]}",
        "fx: 882.5",  # of one camera; it does not say of which
        "principal_point: [320.125, 239.5]",
        "fx_left: 882.5 px",
        "calibration_resolution: VGA",
        "crop: [0, 0, 640, 480]",
        "resize: [640, 480]",
        "downsample: false",
    ],
)
def test_other_keys_are_named(tmp_path: Path, line: str) -> None:
    assert unused(with_lines(tmp_path, line)) == line.partition(":")[0]


@pytest.mark.parametrize(
    "more",
    [
        {"units": "inch"},
        {"T_scale": 2.0},
        {"rectified": True},
        {"projection": "equisolid"},
        {"extra": {"baseline": 777.0}},
    ],
)
def test_every_format_refuses_keys_that_change_the_meaning(tmp_path: Path, more: dict[str, object]) -> None:
    left, _ = written.camera_info_pair(tmp_path)
    r1, _, p1, _ = written.rectified()
    written.camera_info(left, written.K1, written.D1, r1, p1, **more)
    written.camchain(tmp_path / "chain.yaml", **more)
    devices.cameramodels(tmp_path, **more)
    device = devices.device(tmp_path / "oak.json")
    device.write_text(json.dumps({**json.loads(device.read_text()), **more}))
    for files in ("[left.yaml, right.yaml]", "chain.yaml", "[left.cameramodel, right.cameramodel]", "oak.json"):
        refusal(study(tmp_path, rig=f"from: {files}"))


def test_a_pair_of_fisheye_lenses_may_be_named_for_each_side(tmp_path: Path) -> None:
    lens = np.array([[0.01, -0.002, 0.001, 0.0]])
    file = written.opencv(tmp_path / "rig.yml", D1=lens, D2=lens)
    file.write_text(file.read_text() + "distortion_model1: equidistant\ndistortion_model2: equidistant\n")
    path = study(tmp_path, rig=IN_MM)
    assert not unused(path)
    assert "fisheye" in tradestudy.load(path).imported[0]
    assert "contradicts lens_model: pinhole" in refusal(study(tmp_path, rig=f"{IN_MM}, lens_model: pinhole"))


def test_two_files_with_poses_of_their_own_are_refused(tmp_path: Path) -> None:
    for name, k, moved in (("left", written.K1, [0.0, 0.0, 500.0]), ("right", written.K2, [-60.0, 0.0, 500.0])):
        file = written.opencv(tmp_path / f"{name}.yml", T=np.array(moved)[:, None], camera_matrix=k)
        lines = file.read_text().replace("M1:", "A1:").replace("M2:", "A2:").replace("D1:", "B1:").replace("D2:", "B2:")
        file.write_text(lines)
    said = refusal(study(tmp_path, rig="from: [left.yml, right.yml], length_unit: mm"))
    assert "right.yml" in said
    assert "two files contain T" in said


@pytest.mark.parametrize(("key", "unit"), [("T", "m"), ("M1", "mm")])
def test_keys_inside_a_matrix_are_not_overlooked(tmp_path: Path, key: str, unit: str) -> None:
    file = written.opencv(tmp_path / "rig.yml")
    file.write_text(file.read_text().replace(f"{key}: !!opencv-matrix\n", f"{key}: !!opencv-matrix\n   unit: {unit}\n"))
    assert f"rig.{key}.unit: {unit} is not the unit in which" in refusal(study(tmp_path, rig=IN_MM))


def test_transforms_of_kalibr_that_contradict_the_chain_are_refused(tmp_path: Path) -> None:
    chain = written.camchain(tmp_path / "chain.yaml").read_text()
    lines = [json.loads(line.partition(": ")[2]) for line in chain.splitlines()]
    body = np.linalg.inv(np.array([[0.0, 1, 0, 0.1], [0, 0, 1, 0.2], [1, 0, 0, 0.3], [0, 0, 0, 1]]))
    right = np.array(lines[1]["T_cn_cnm1"]) @ body
    path = study(tmp_path, rig="from: chain.yaml")
    for shift, agrees in ((0.0, True), (0.01, False)):
        right[0, 3] += shift
        for camera, transform in zip(lines, (body, right), strict=True):
            camera["T_cam_imu"] = transform.tolist()
        (tmp_path / "chain.yaml").write_text("\n".join(f"cam{n}: {json.dumps(one)}" for n, one in enumerate(lines)))
        if agrees:
            assert "T_cam_imu" not in unused(path)
        else:
            assert (
                "by T_cam_imu, the second camera is 0.01 (of a baseline of 0.0601) and 0° from where T_cn_cnm1 places"
                in refusal(path)
            )


def test_the_translation_beside_projections_must_agree_with_them(tmp_path: Path) -> None:
    _, _, p1, p2 = written.rectified()
    p2[0, 3] *= 1e3  # the translation of `written` is in mm
    path = study(tmp_path, rig=f"{IN_MM}, pictures: rectified")
    written.opencv(tmp_path / "rig.yml", P1=p1, P2=p2)
    assert unused(path) == "M1, D1, M2, D2, R"
    written.opencv(tmp_path / "rig.yml", P1=p1, P2=2.0 * p2 - p2 * [1, 1, 1, 0])
    assert "rig.T: 60.1 mm contradicts the baseline that is read, 120 mm" in refusal(path).replace(
        "\N{NO-BREAK SPACE}", " "
    )


def turned_by(vector: list[float]) -> np.ndarray:
    """A rotation matrix by OpenCV, from a rotation vector [rad]."""
    return cv2.Rodrigues(np.array(vector))[0]


def test_second_values_of_a_rig_with_unequal_cameras_are_told_apart(tmp_path: Path) -> None:
    k1, k2 = (
        np.array([[f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]]) for f, cx, cy in ((1010, 640.5, 470), (980, 655, 480))
    )
    turn, moved = [0.002, 0.02, -0.003], np.array([-120.0, 0.4, 1.2])
    back = -turned_by(turn).T @ moved
    file = written.opencv(tmp_path / "rig.yml", size=(1280, 960), M1=k1, M2=k2, R=turned_by(turn), T=moved[:, None])
    path, before = study(tmp_path, rig=IN_MM), file.read_text()
    for lines, said in {
        "fx_left: 980\nfx_right: 1010": "980 contradicts the camera matrix that is read, 1010 px of camera 1",
        "cx_left: 655\ncx_right: 640.5": "655 contradicts the camera matrix that is read, 640.5 px of camera 1",
        "om: [-0.002, -0.02, 0.003]": "a rotation by 1.16° the other way, like the inverse pose, contradicts",
        f"tvec: {back.tolist()}": "points the opposite way, like that of the inverse pose",
        "om: [0.0203224, 0, 0]": "a rotation by 1.16° about another axis contradicts",
        "tvec: [0, 0, 120]": "contradicts the translation that is read",
    }.items():
        file.write_text(f"{before}{lines}\n")
        assert said in refusal(path).replace("\N{NO-BREAK SPACE}", " ")
    file.write_text(f"{before}fx_left: 1010\nfx_right: 980\ncx_left: 640.5\ncx_right: 655\nom: {turn}\n")
    assert not unused(path)


def test_second_values_of_a_vertical_rig_are_those_of_its_pictures_as_taken(tmp_path: Path) -> None:
    k = np.array([[900.0, 0.0, 310.0], [0.0, 870.0, 250.0], [0.0, 0.0, 1.0]])
    turn, moved = [0.004, -0.013, 0.0021], [0.2, -60.1, 1.1]
    file = written.opencv(tmp_path / "rig.yml", M1=k, M2=k, R=turned_by(turn), T=np.array(moved)[:, None])
    path, before = study(tmp_path, rig=IN_MM), file.read_text()
    agree = f"fx: 900\nfy: 870\ncx: 310\ncy: 250\ncalib_width: 640\ncalib_height: 480\nrvec: {turn}\ntvec: {moved}\n"
    file.write_text(before + agree)
    assert not unused(path)
    for line in (
        "fx: 870",
        "cx: 250",
        "calib_width: 480",
        "rvec: [-0.013, -0.004, 0.0021]",
        "tvec: [-60.1, -0.2, 1.1]",
    ):
        file.write_text(f"{before}{line}\n")
        assert "contradicts" in refusal(path)


def test_second_values_of_a_rig_in_the_other_order_are_those_of_the_file(tmp_path: Path) -> None:
    turn, moved = [0.004, -0.013, 0.0021], [60.1, 0.2, 1.1]
    file = written.opencv(tmp_path / "rig.yml", R=turned_by(turn), T=np.array(moved)[:, None])
    path, before = study(tmp_path, rig=f"{IN_MM}, pair: [2, 1]"), file.read_text()
    file.write_text(f"{before}fx_1: 882.5\nfx_2: 880.25\nom: {turn}\ntvec: {moved}\nfx_left: 882.5\n")
    assert unused(path) == "fx_left"  # of camera 1, or of the camera on the left
    for line in ("fx_1: 880.25", "om: [-0.004, 0.013, -0.0021]", "tvec: [-60.1, 0.2, 1.1]", "fx_left: 900"):
        file.write_text(f"{before}{line}\n")
        assert "contradicts" in refusal(path)


def test_second_values_belong_to_the_camera_of_their_file_or_mapping(tmp_path: Path) -> None:
    chain = written.camchain(tmp_path / "chain.yaml").read_text()
    both = "from: [left.yml, right.yml, rig.yml], length_unit: mm"
    for number, k, values in (("1", written.K1, written.D1), ("2", written.K2, written.D2)):
        name = {"1": "left", "2": "right"}[number]
        lines = written.opencv(tmp_path / f"{name}.yml", camera_matrix=k, dist_coeffs=values[None]).read_text()
        kept = lines[: lines.index("M1:")] + lines[lines.index("camera_matrix:") :]
        (tmp_path / f"{name}.yml").write_text(f"{kept}fx: 882.5\n")
    written.opencv(tmp_path / "rig.yml")
    lines = (tmp_path / "rig.yml").read_text()
    (tmp_path / "rig.yml").write_text(f"%YAML:1.0\n---\n{lines[lines.index('R: ') :]}")
    assert "right.yml:" in (said := refusal(study(tmp_path, rig=both)))
    assert "882.5 contradicts the camera matrix that is read, 880.25 px of right" in said
    for first, second, agrees in ((882.5, 880.25, True), (880.25, 882.5, False)):
        lines = chain.replace('{"', f'{{"fx": {first}, "', 1).replace('cam1: {"', f'cam1: {{"fx": {second}, "')
        (tmp_path / "chain.yaml").write_text(lines)
        path = study(tmp_path, rig="from: chain.yaml")
        if agrees:
            assert "fx" not in unused(path)
        else:
            assert "cam0.fx: 880.25 contradicts the camera matrix that is read, 882.5 px of cam0" in refusal(path)


def test_a_flag_to_downsample_is_refused_in_every_camera_of_a_chain(tmp_path: Path) -> None:
    written.camchain(tmp_path / "chain.yaml", downsample=True)
    assert "cam0.downsample: this key looks like a scale" in refusal(study(tmp_path, rig="from: chain.yaml"))


def test_the_inverse_translation_beside_projections_is_refused(tmp_path: Path) -> None:
    _, _, p1, p2 = written.rectified()
    p2[0, 3] *= 1e3  # the translation of `written` is in mm
    written.opencv(tmp_path / "rig.yml", P1=p1, P2=p2, T=-1e3 * written.T[:, None])
    said = refusal(study(tmp_path, rig=f"{IN_MM}, pictures: rectified"))
    assert "rig.T: " in said
    assert "points the opposite way" in said


def epipolar() -> tuple[np.ndarray, np.ndarray]:
    """E and F of the rig: E by the products of t, F by OpenCV from points that both cameras see without distortion."""
    x, y, z = written.T
    essential = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ written.R
    points = np.random.default_rng(5).uniform([-1.0, -0.7, 1.5], [1.0, 0.7, 4.0], (40, 3))
    seen = [
        cv2.projectPoints(points, rotation, moved, k, None)[0][:, 0]
        for rotation, moved, k in (
            (np.eye(3), np.zeros(3), written.K1),
            (written.R, written.T, written.K2),
        )
    ]
    return essential, cv2.findFundamentalMat(*seen, cv2.FM_8POINT)[0]


def test_epipolar_geometry_beside_the_pose_must_agree_with_it(tmp_path: Path) -> None:
    essential, fundamental = epipolar()
    path = study(tmp_path, rig=IN_MM)
    other = essential @ turned_by([0.0, 0.05, 0.0])
    for matrices, said in (
        ({"E": 1e3 * essential, "F": fundamental}, ""),
        ({"E": -essential / np.linalg.norm(essential), "essential_matrix": essential}, ""),
        ({"fundamentalMatrix": -fundamental}, ""),
        ({"E": essential.T}, "rig.E: this essential matrix is that of the inverse pose, and contradicts the pose"),
        ({"E": other}, "rig.E: this essential matrix contradicts the pose that is read"),
        ({"F": fundamental.T}, "rig.F: this fundamental matrix is that of the inverse pose"),
        ({"F": np.linalg.inv(written.K2).T @ other @ np.linalg.inv(written.K1)}, "rig.F: this fundamental matrix"),
    ):
        written.opencv(tmp_path / "rig.yml", **matrices)
        if said:
            assert said in refusal(path)
        else:
            assert not unused(path)
    written.opencv(tmp_path / "rig.yml", E=np.eye(3), F=np.zeros((3, 3)))  # of no pose
    assert unused(path) == "E, F"


def test_the_essential_matrix_of_a_vertical_rig_is_that_of_its_pictures_as_taken(tmp_path: Path) -> None:
    essential = np.array([[0.0, -1.1, -60.1], [1.1, 0.0, -0.2], [60.1, 0.2, 0.0]])
    written.opencv(tmp_path / "rig.yml", R=np.eye(3), T=np.array([[0.2], [-60.1], [1.1]]), lengths=1.0, E=essential)
    path = study(tmp_path, rig=IN_MM)
    assert not unused(path)
    written.opencv(tmp_path / "rig.yml", R=np.eye(3), T=np.array([[0.2], [-60.1], [1.1]]), E=essential[:, ::-1])
    assert "rig.E: this essential matrix contradicts" in refusal(path)


def test_mrcal_poses_that_contradict_each_other_are_refused(tmp_path: Path) -> None:
    devices.cameramodels(tmp_path, extrinsics=[0.0, 0.0, 0.0, 1.0, 2.0, 3.0])
    said = refusal(study(tmp_path, rig="from: [left.cameramodel, right.cameramodel]"))
    assert "rt_cam_ref and extrinsics mean the same, but their values differ" in said


@pytest.mark.parametrize(
    ("line", "told", "said"),
    [
        ("fisheye_model: 0", "fisheye", "fisheye_model: 0 contradicts lens_model: fisheye of the study"),
        ("fisheye: false", "fisheye", "fisheye: false contradicts lens_model: fisheye of the study"),
        ("distortion_model: plumb_bob", "fisheye", "plumb_bob contradicts lens_model: fisheye of the study"),
        ("distortion_model: equidistant", "pinhole", "equidistant contradicts lens_model: pinhole of the study"),
        ("distortion_model: omni", "fisheye", "the lens model 'omni' is unknown"),
        ("camera_model: AB-12C", "pinhole", "'AB-12C' is unknown; write fisheye if the coefficients are k1 to k4, or "),
        ("camera_model: AB-12C", "pinhole", "; remove this key if it names the camera"),
        ("fisheye_model: 0", "pinhole", ""),
        ("fisheye_model: 1", "fisheye", ""),
        ("camera_model: pinhole", "fisheye", ""),  # the camera without its distortion
    ],
)
def test_the_study_and_the_file_must_agree_on_the_lens(tmp_path: Path, line: str, told: str, said: str) -> None:
    lens = np.array([[0.01, -0.002, 0.001, 0.0]])
    file = written.opencv(tmp_path / "rig.yml", D1=lens, D2=lens)
    file.write_text(f"{file.read_text()}{line}\n")
    path = study(tmp_path, rig=f"{IN_MM}, lens_model: {told}")
    if said:
        assert said in refusal(path)
    else:
        assert f"lens model {told}" in tradestudy.load(path).imported[0]


@pytest.mark.parametrize(
    "lines",
    [
        "lens_type: PINHOLE\nparameters_of_projection:\n   fx: 460.\n   fy: 459.\n   cx: 367.\n   cy: 248.\n",
        "Sensor_type: PinHole\nSensor_fx: 458.6\nSensor_fy: 457.3\nSensor_cx: 367.2\nSensor_cy: 248.4\n",
    ],
)
def test_opencv_files_without_a_camera_matrix_are_refused_with_this_cause(tmp_path: Path, lines: str) -> None:
    (tmp_path / "rig.yml").write_text(f"%YAML:1.0\n---\n{lines}")
    said = refusal(study(tmp_path, rig=IN_MM))
    assert "no camera matrix is given under any of the known keys" in said
    assert f"but the file has {lines.partition(':')[0]}, " in said


@pytest.mark.parametrize("kind", ["fisheye", "pinhole"])
def test_the_study_and_a_file_of_ros_or_kalibr_must_agree_on_the_lens(tmp_path: Path, kind: str) -> None:
    """Fisheye coefficients read as those of a pinhole, or the reverse, change depth off the axis several times."""
    lens = np.array([0.01, -0.002, 0.001, 0.0])
    r1, r2, p1, p2 = written.rectified()
    ros, chain = study(tmp_path, rig=f"from: [l.yaml, r.yaml], lens_model: {kind}"), tmp_path / "chain.yaml"
    for name, agrees in (("plumb_bob", kind == "pinhole"), ("equidistant", kind == "fisheye")):
        written.camera_info(tmp_path / "l.yaml", written.K1, lens, r1, p1, distortion_model=name)
        written.camera_info(tmp_path / "r.yaml", written.K2, lens, r2, p2, distortion_model=name)
        if agrees:
            assert f"lens model {kind}" in tradestudy.load(ros).imported[0]
        else:
            assert f"{name} contradicts lens_model: {kind} of the study; remove the wrong one" in refusal(ros)
    rectified = study(tmp_path, rig=f"from: [l.yaml, r.yaml], pictures: rectified, lens_model: {kind}")
    assert "lens_model does not apply to rectified pictures" in refusal(rectified)
    kalibr = study(tmp_path, rig=f"from: chain.yaml, lens_model: {kind}")
    for name, agrees in (("radtan", kind == "pinhole"), ("equidistant", kind == "fisheye")):
        written.camchain(chain, lenses=(lens, lens), distortion_model=name)
        if agrees:
            assert f"lens model {kind}" in tradestudy.load(kalibr).imported[0]
        else:
            assert f"{name} contradicts lens_model: {kind} of the study; remove the wrong one" in refusal(kalibr)
    text = chain.read_text().replace('"distortion_model": "equidistant", ', "")
    chain.write_text(text)
    if kind == "fisheye":
        assert "lens model fisheye" in tradestudy.load(kalibr).imported[0]
    else:
        assert "distortion_model is missing" in refusal(kalibr)


def test_names_that_contradict_the_geometry_are_questioned(tmp_path: Path) -> None:
    r1, r2, p1, p2 = written.rectified()
    path = study(tmp_path, rig="from: [a.yaml, b.yaml]")
    for names, is_questioned in (
        (("stereo/left", "stereo/right"), False),
        (("stereo/right", "stereo/left"), True),
        (("b", "a"), False),
    ):
        written.camera_info(tmp_path / "a.yaml", written.K1, written.D1, r1, p1, camera_name=names[0])
        written.camera_info(tmp_path / "b.yaml", written.K2, written.D2, r2, p2, camera_name=names[1])
        loaded = tradestudy.load(path)
        warned = [str(problem) for problem in implausible(loaded.prepared)]
        said = "by the geometry, stereo/right is the left camera, and stereo/left the right one; check the names"
        assert any(said in warning for warning in warned) == is_questioned


def test_the_baseline_of_a_reprojection_matrix_must_be_the_one_that_is_read(tmp_path: Path) -> None:
    moved = 1e3 * written.T[:, None]
    q = cv2.stereoRectify(written.K1, written.D1, written.K2, written.D2, written.SIZE, written.R, moved)[4]
    path = study(tmp_path, rig=IN_MM)
    written.opencv(tmp_path / "rig.yml", Q=q)
    assert not unused(path)
    q[3, 2] /= 2.0
    written.opencv(tmp_path / "rig.yml", Q=q)
    assert "rig.Q: 120 mm contradicts the baseline that is read" in refusal(path).replace("\N{NO-BREAK SPACE}", " ")
