"""Rigs whose lenses need more than k1 and k2: every format brings them, and depth is read with them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import get_args

import cv2
import numpy as np
import pytest
from scipy.optimize import root

import tradestudy
from tests.study.camera_files import devices, written
from tests.study.camera_files.test_export import BROWN, FISHEYE, READ_BACK, pair
from tests.study.camera_files.test_import import ERRORS, calibrated, refusal
from tests.study.camera_files.written import K1, K2, R, T, study
from tradestudy import api
from tradestudy.cameras.imported import LensModelName
from tradestudy.cameras.stereo.design import StereoRig
from tradestudy.optics.lens_families import FAMILIES, DoubleSphere
from tradestudy.study.camera_files.located import Format

FOREIGN = {"stereographic", "longitude-latitude"}
RADTAN = (np.array([-0.25, 0.125, 1.5e-3, -2.5e-3]), np.array([-0.24, 0.09, -1e-3, 5e-4]))
RATIONAL = tuple(np.append(one, more) for one, more in zip(RADTAN, ([0.01, 0.2, -0.03, 0.004],) * 2, strict=True))
FULL = tuple(np.append(one, [1e-3, -2e-4, 3e-4, 4e-5, 0.01, -0.02]) for one in RATIONAL)
FISHEYES = (np.array([-0.03, 0.01, -0.004, 0.001]), np.array([-0.02, 0.008, -0.003, 0.0005]))


def test_lens_model_names_of_files_are_the_families_and_two_refused_ones() -> None:
    assert {*get_args(LensModelName)} == {*FAMILIES} | FOREIGN


@pytest.mark.parametrize(
    ("one", "model", "coefficients"), [row for row in READ_BACK if row[1] not in FOREIGN and row[2] is not BROWN]
)
def test_every_lens_becomes_a_camera_and_is_exported_again(
    tmp_path: Path, one: Format, model: LensModelName, coefficients: Mapping[str, float]
) -> None:
    assert one.write is not None
    unit = ", length_unit: m" if one.word == "opencv" else ""
    files = one.write(pair(model, coefficients), "first")
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    first = study(tmp_path, rig=f"from: [{', '.join(files)}]{unit}")
    before = calibrated(first)
    for lens in before.lenses:
        assert lens.name == model
        given = {name: value for name, value in lens.coefficients().items() if value}
        assert given == pytest.approx(coefficients, rel=1e-14)
    paths, _ = api.export(api.load(first), "rig", tmp_path, formats=(one.word,))
    after = calibrated(study(tmp_path, rig=f"from: [{', '.join(path.name for path in paths)}]{unit}"))
    np.testing.assert_allclose(after.parameters, before.parameters, rtol=1e-12, atol=1e-15)
    for old, new in zip(before.lenses, after.lenses, strict=True):
        assert new.coefficients() == pytest.approx(old.coefficients(), rel=1e-12)


def spreads(folder: Path, **cameras: str) -> dict[str, np.ndarray]:
    loaded = tradestudy.load(study(folder, **{name: f"{said}, {ERRORS}" for name, said in cameras.items()}))
    distances = loaded.prepared.case.distance
    return {name: loaded.cameras[name].depth_uncertainty(distances).values for name in cameras}


def rows(lenses: tuple[np.ndarray, ...]) -> dict[str, np.ndarray]:
    return {"D1": lenses[0][None], "D2": lenses[1][None]}


def camera_info_pair(folder: Path, lenses: tuple[np.ndarray, ...], model: str) -> None:
    r1, r2, p1, p2 = written.rectified()
    for name, k, d, r, p in (("left", K1, lenses[0], r1, p1), ("right", K2, lenses[1], r2, p2)):
        written.camera_info(folder / f"{name}.yaml", k, d, r, p, distortion_model=model)


def test_a_rational_lens_reads_the_same_depths_from_opencv_ros_and_mrcal(tmp_path: Path) -> None:
    written.opencv(tmp_path / "rig.yml", **rows(RATIONAL))
    camera_info_pair(tmp_path, RATIONAL, "rational_polynomial")
    devices.cameramodels(tmp_path, lensmodel="LENSMODEL_OPENCV8", lenses=RATIONAL)
    found = spreads(
        tmp_path,
        opencv="from: rig.yml, length_unit: mm",
        ros="from: [left.yaml, right.yaml]",
        mrcal="from: [left.cameramodel, right.cameramodel]",
    )
    assert np.all(found["opencv"] > 0.0)
    for name in ("ros", "mrcal"):
        np.testing.assert_allclose(found[name], found["opencv"], rtol=1e-9)


def test_a_kalibr_radtan_rig_reads_the_same_depths_as_in_the_files_of_others(tmp_path: Path) -> None:
    written.opencv(tmp_path / "rig.yml", **rows(RADTAN))
    camera_info_pair(tmp_path, tuple(np.append(one, 0.0) for one in RADTAN), "plumb_bob")
    written.camchain(tmp_path / "chain.yaml", lenses=RADTAN)
    found = spreads(
        tmp_path,
        opencv="from: rig.yml, length_unit: mm",
        ros="from: [left.yaml, right.yaml]",
        kalibr="from: chain.yaml",
        pinhole="from: [left.yaml, right.yaml], pictures: rectified",
    )
    for name in ("ros", "kalibr"):
        np.testing.assert_allclose(found[name], found["opencv"], rtol=1e-9)
    # What all of them agree on is more than a pinhole pair would say.
    assert np.max(np.abs(found["pinhole"] / found["opencv"] - 1.0)) > 1e-4


def test_a_fisheye_rig_reads_the_same_depths_from_opencv_ros_and_kalibr(tmp_path: Path) -> None:
    written.opencv(tmp_path / "rig.yml", **rows(FISHEYES))
    camera_info_pair(tmp_path, FISHEYES, "equidistant")
    written.camchain(tmp_path / "chain.yaml", lenses=FISHEYES, distortion_model="equidistant")
    found = spreads(
        tmp_path,
        opencv="from: rig.yml, length_unit: mm, lens_model: fisheye",
        ros="from: [left.yaml, right.yaml]",
        kalibr="from: chain.yaml",
    )
    for name in ("ros", "kalibr"):
        np.testing.assert_allclose(found[name], found["opencv"], rtol=1e-9)


def depth_by_opencv(lenses: tuple[np.ndarray, ...], wrong: Mapping[str, float], point: np.ndarray) -> float:
    """Depth that a wrong calibration reads of a point, by rays that OpenCV projects to the same pixels."""
    project = cv2.fisheye.projectPoints if len(lenses[0]) == 4 else cv2.projectPoints

    def seen(where: np.ndarray, k: np.ndarray, d: np.ndarray) -> np.ndarray:
        return project(where.reshape(1, 1, 3), np.zeros((3, 1)), np.zeros((3, 1)), k, d)[0].ravel()

    rays = []
    for side, where, k, d in (("left", point, K1, lenses[0]), ("right", R @ point + T, K2, lenses[1])):
        believed_k, believed_d = k.copy(), d.copy()
        believed_k[0, 0] += wrong[f"{side}_focal_length_x_px"]
        believed_d[0] += wrong[f"{side}_radial_distortion_k1"]
        pixel = seen(where, k, d)
        found = root(lambda ray: seen(np.append(ray, 1.0), believed_k, believed_d) - pixel, where[:2] / where[2]).x  # noqa: B023 - called at once
        np.testing.assert_allclose(seen(np.append(found, 1.0), believed_k, believed_d), pixel, atol=1e-9)
        rays.append(np.append(found, 1.0))
    turned = cv2.Rodrigues(cv2.Rodrigues(R)[0] + np.array([[0.0], [wrong["relative_rotation_y"]], [0.0]]))[0]
    left, slope = turned @ rays[0], rays[1][0]
    return float((slope * T[2] - T[0]) / (left[0] - slope * left[2]))


@pytest.mark.parametrize(("lenses", "said"), [(FULL, ""), (FISHEYES, ", lens_model: fisheye")])
def test_a_wrong_calibration_reads_what_opencv_would(tmp_path: Path, lenses: tuple[np.ndarray, ...], said: str) -> None:
    """A calibration off in focal length, rotation and k1, of lenses with all coefficients."""
    written.opencv(tmp_path / "rig.yml", **rows(lenses))
    path = study(tmp_path, rig=f"from: rig.yml, length_unit: mm{said}")
    measurement = tradestudy.load(path).prepared.case.cameras["rig"].calibration.measurement
    assert measurement is not None
    wrong = {
        "left_focal_length_x_px": 0.5,
        "right_focal_length_x_px": -0.2,
        "left_radial_distortion_k1": 1e-3,
        "right_radial_distortion_k1": -2e-3,
        "relative_rotation_y": 1e-4,
    }
    errors = {name: np.full((1, 1), value) for name, value in wrong.items()}
    for distance, field in ((0.4, 0.0), (1.5, 0.5)):
        z = np.array([distance])
        point = measurement._points(z, field)[0]  # type: ignore[attr-defined]
        read = 1.0 / measurement(z, field, errors, None).inverse_depth.item()
        assert abs(read / distance - 1.0) > 1e-4
        assert read == pytest.approx(depth_by_opencv(lenses, wrong, point), rel=1e-8)


def test_a_fisheye_rig_is_as_wide_as_its_lenses(tmp_path: Path) -> None:
    """Where OpenCV puts the edges of the picture; a pinhole of this focal length would see 92°."""
    k = np.array([[309.0, 0.0, 319.5], [0.0, 309.0, 239.5], [0.0, 0.0, 1.0]])
    lens = np.array(list(FISHEYE.values()))
    written.opencv(tmp_path / "rig.yml", M1=k, M2=k, **rows((lens, lens)))
    rig = tradestudy.load(study(tmp_path, rig="from: rig.yml, length_unit: mm, lens_model: fisheye")).definition
    design = rig.designs["rig"]
    assert isinstance(design, StereoRig)
    edge = cv2.fisheye.undistortPoints(np.array([[[-0.5, 239.5]]]), k, lens).ravel()[0]
    assert design.field_of_view == pytest.approx(2.0 * np.arctan(-edge), rel=1e-9)
    assert design.field_of_view > np.radians(110.0)
    said = dict(design.properties())
    assert (
        said["left lens model"] == said["right lens model"] == "kannala-brandt (k1 -0.03, k2 0.01, k3 -0.004, k4 0.001)"
    )


def test_a_declared_rig_is_exported_with_its_distortion(tmp_path: Path) -> None:
    said = (
        "kind: stereo, lenses: {focal_length: 400 px}, sensor: {pixels: [640, 480], pixel_pitch: 3 um}, "
        "baseline: 80 mm, distortion: {model: double-sphere, xi: -0.2, alpha: 0.59}"
    )
    api.export(api.load(study(tmp_path, rig=said)), "rig", tmp_path, formats=("kalibr",))
    found = calibrated(study(tmp_path, rig="from: rig-camchain.yaml"))
    assert found.lenses == (DoubleSphere(xi=-0.2, alpha=0.59),) * 2
    np.testing.assert_allclose(found.parameters[:4], [400.0, 400.0, 319.5, 239.5], rtol=1e-12)


@pytest.mark.parametrize("model", ["STEREOGRAPHIC", "LONLAT"])
def test_a_lens_that_no_camera_can_have_is_refused_by_name_at_its_place(tmp_path: Path, model: str) -> None:
    devices.cameramodels(tmp_path, lensmodel=f"LENSMODEL_{model}", intrinsics=[500.0, 500.0, 319.5, 239.5])
    said = refusal(study(tmp_path, rig="from: [left.cameramodel, right.cameramodel]"))
    assert f"{tmp_path}/left.cameramodel:" in said
    name = {"STEREOGRAPHIC": "stereographic", "LONLAT": "longitude-latitude"}[model]
    assert f"cameras.rig.geometry.left.distortion.model: '{name}' is unknown; 'rational', 'kannala-brandt'" in said


def test_errors_of_radial_terms_that_a_lens_lacks_are_refused(tmp_path: Path) -> None:
    written.camchain(tmp_path / "chain.yaml", distortion_model="fov", distortion_coeffs=[0.9])
    errors = "calibration: {errors: {right_distortion_k1: {standard_deviation: 0.001}}}"
    said = refusal(study(tmp_path, rig=f"from: chain.yaml, {errors}"))
    assert re.search(r"cameras\.rig\.calibration\.errors\.right_distortion_k1: .*fov .*k1 and k2", said)


def test_a_coefficient_outside_its_range_is_refused_at_its_place(tmp_path: Path) -> None:
    chain = written.camchain(
        tmp_path / "chain.yaml",
        camera_model="eucm",
        intrinsics=[2.0, 1.1, 880.0, 880.0, 320.0, 240.0],
        distortion_model="none",
        distortion_coeffs=[],
    )
    message = refusal(study(tmp_path, rig=f"from: {chain.name}"))
    assert re.search(r"chain\.yaml:1:\d+: cameras\.rig\.cam0\.intrinsics: .*alpha .*eucm: 2 .*at most 1", message)
