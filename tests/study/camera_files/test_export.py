"""What is exported is read back: every bit of a pair, and what a format cannot hold is refused by name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.study.camera_files import written
from tests.study.camera_files.test_import import ERRORS, expected, shared
from tests.study.camera_files.written import SIZE, study
from tradestudy import api
from tradestudy.cameras.calibrated_pair import CalibratedPair
from tradestudy.cameras.imported import ImportedCamera, ImportedRig, LensModelName
from tradestudy.cameras.stereo.pair import rig_of_calibration
from tradestudy.errors import TradestudyError
from tradestudy.study.camera_files import kalibr, mrcal, opencv, ros
from tradestudy.study.camera_files.importing import recognised
from tradestudy.study.camera_files.located import Format, Request, UnsupportedLensError

BROWN = {"k1": -0.25, "k2": 0.125, "p1": 1.5e-3, "p2": -2.5e-3}
RATIONAL = {**BROWN, "k3": 0.01, "k4": 0.2, "k5": -0.03, "k6": 0.004}
PRISM = {**RATIONAL, "s1": 1e-3, "s2": -2e-4, "s3": 3e-4, "s4": 4e-5}
FISHEYE = {"k1": -0.03, "k2": 0.01, "k3": -0.004, "k4": 0.001}
READ_BACK: list[tuple[Format, LensModelName, Mapping[str, float]]] = [
    *((one, "rational", BROWN) for one in (opencv.FORMAT, ros.FORMAT, kalibr.FORMAT, mrcal.FORMAT)),
    *((one, "rational", RATIONAL) for one in (opencv.FORMAT, ros.FORMAT, mrcal.FORMAT)),
    *((one, "rational", PRISM) for one in (opencv.FORMAT, mrcal.FORMAT)),
    (opencv.FORMAT, "rational", {**PRISM, "tau_x": 0.01, "tau_y": -0.02}),
    *((one, "kannala-brandt", FISHEYE) for one in (opencv.FORMAT, ros.FORMAT, kalibr.FORMAT)),
    (kalibr.FORMAT, "fov", {"w": 0.92}),
    (kalibr.FORMAT, "omni", {"xi": 1.1, **BROWN}),
    (kalibr.FORMAT, "double-sphere", {"xi": -0.2, "alpha": 0.59}),
    (kalibr.FORMAT, "eucm", {"alpha": 0.6, "beta": 1.1}),
    (mrcal.FORMAT, "stereographic", {}),
    (mrcal.FORMAT, "longitude-latitude", {}),
]


def pair(model: LensModelName, coefficients: Mapping[str, float]) -> ImportedRig:
    rig = rig_of_calibration(CalibratedPair(parameters=tuple(expected())), SIZE)
    lens = {"lens_model": model, "coefficients": coefficients}
    return replace(rig, left=replace(rig.left, **lens), right=replace(rig.right, **lens))  # type: ignore[arg-type]


def numbers(camera: ImportedCamera) -> dict[str, float]:
    """Everything that a camera says in numbers; coefficients of 0 say nothing."""
    return {
        **{name: value for name, value in camera.coefficients.items() if value != 0.0},
        **dict(zip(("fx", "fy", "cx", "cy"), (*camera.focal_lengths, *camera.centre), strict=True)),
    }


@pytest.mark.parametrize(("one", "model", "coefficients"), READ_BACK)
def test_every_lens_is_read_back(
    tmp_path: Path, one: Format, model: LensModelName, coefficients: Mapping[str, float]
) -> None:
    rig = pair(model, coefficients)
    assert one.write is not None
    files = []
    for name, text in one.write(rig, "rig").items():
        (tmp_path / name).write_text(text)
        file = recognised(tmp_path / name, text, name)
        assert file is not None
        assert one.recognises(file)
        files.append(file)
    found = one.read(files, Request(length_unit="m"))
    assert isinstance(found, ImportedRig)
    for before, after in ((rig.left, found.left), (rig.right, found.right)):
        assert after.lens_model == model
        assert after.pixels == SIZE
        assert numbers(after) == pytest.approx(numbers(before), rel=1e-12)
    np.testing.assert_allclose(found.rotation, rig.rotation, atol=1e-13)
    np.testing.assert_allclose(found.translation, rig.translation, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("one", "model", "coefficients", "names"),
    [
        (kalibr.FORMAT, "rational", RATIONAL, ("k3", "k4", "k5", "k6")),
        (ros.FORMAT, "rational", PRISM, ("s1", "s2", "s3", "s4")),
        (mrcal.FORMAT, "kannala-brandt", FISHEYE, ("the lens model kannala-brandt",)),
        (opencv.FORMAT, "double-sphere", {"xi": -0.2, "alpha": 0.59}, ("the lens model double-sphere",)),
    ],
)
def test_parts_that_a_format_cannot_represent_are_refused_by_name(
    one: Format, model: LensModelName, coefficients: Mapping[str, float], names: tuple[str, ...]
) -> None:
    assert one.write is not None
    with pytest.raises(UnsupportedLensError) as caught:
        one.write(pair(model, coefficients), "rig")
    assert caught.value.names == names


def test_omitted_parts_are_reported_with_how_far_they_move_points(tmp_path: Path) -> None:
    """A thin prism s1 moves a point at the slope r from the axis across by s1 r², by OpenCV's definition."""
    rig = pair("rational", {"s1": 0.002})
    assert opencv.FORMAT.write is not None
    for name, text in opencv.FORMAT.write(rig, "prism").items():
        (tmp_path / name).write_text(text)
    loaded = api.load(study(tmp_path, rig="from: prism-opencv.yml, length_unit: m"))
    _, left_out = api.export(loaded, "rig", tmp_path / "out", formats=("kalibr",), lossy=True)
    (shift,) = re.fullmatch(r".* s1, without which points move by up to (\S+) px", left_out[0]).groups()
    corners = np.array([(x, y) for x in (0, SIZE[0] - 1) for y in (0, SIZE[1] - 1)])
    moved = [
        one.focal_lengths[0] * 0.002 * np.sum(((corners - one.centre) / one.focal_lengths) ** 2, axis=1)
        for one in (rig.left, rig.right)
    ]
    assert float(shift) == pytest.approx(np.max(moved), rel=0.02)  # to the digits shown, and to second order in s1


def test_an_imported_rig_is_exported_to_every_format_and_read_back(tmp_path: Path) -> None:
    written.camchain(tmp_path / "chain.yaml")
    loaded = api.load(study(tmp_path, rig=f"from: chain.yaml, {ERRORS}"))
    paths, left_out = api.export(loaded, "rig", tmp_path)
    assert {path.name for path in paths} == {
        "rig-opencv.yml",
        "rig-left.yaml",
        "rig-right.yaml",
        "rig-camchain.yaml",
        "rig-left.cameramodel",
        "rig-right.cameramodel",
        "rig-posterior.nc",
    }
    assert left_out == ()
    for said in (
        "from: rig-opencv.yml, length_unit: m",
        "from: [rig-left.yaml, rig-right.yaml]",
        "from: rig-camchain.yaml",
        "from: [rig-left.cameramodel, rig-right.cameramodel]",
    ):
        again = shared(study(tmp_path, rig=said))
        np.testing.assert_allclose(again, expected(), rtol=1e-12, atol=1e-14)
    again_loaded = api.load(study(tmp_path, rig="from: chain.yaml, calibration: {posterior: {file: rig-posterior.nc}}"))
    (group,) = again_loaded.prepared.case.cameras["rig"].calibration.groups
    spread = dict(zip(group.parameters, np.std(group.draws, axis=0), strict=True))  # type: ignore[attr-defined]
    assert spread["yaw"] == pytest.approx(np.radians(0.02), rel=0.05)
    assert spread["baseline"] == pytest.approx(1e-4, rel=0.05)


def test_opencv_reads_a_designed_rig_with_converging_axes(tmp_path: Path) -> None:
    """A point on both axes is in the middle of both pictures, by OpenCV's own projection of what it reads."""
    said = (
        "kind: stereo, lenses: {focal_length: 882.5 px}, sensor: {pixels: [640, 480], pixel_pitch: 3 um}, "
        "baseline: 80 mm, convergence_distance: 0.9 m"
    )
    api.export(api.load(study(tmp_path, rig=said)), "rig", tmp_path, formats=("opencv",))
    storage = cv2.FileStorage(str(tmp_path / "rig-opencv.yml"), cv2.FILE_STORAGE_READ)
    m1, d1, m2, d2, r, t = (storage.getNode(name).mat() for name in ("M1", "D1", "M2", "D2", "R", "T"))
    assert np.linalg.norm(t) == pytest.approx(0.08, rel=1e-15)
    on_axis = np.array([[0.0, 0.0, np.hypot(0.9, 0.04)]])
    for pose, k, d in (((np.zeros(3), np.zeros(3)), m1, d1), ((cv2.Rodrigues(r)[0], t), m2, d2)):
        seen = cv2.projectPoints(on_axis, *pose, k, d)[0].ravel()
        np.testing.assert_allclose(seen, [319.5, 239.5], atol=1e-9)


def test_cameras_that_cannot_be_exported_are_refused_with_a_reason(tmp_path: Path) -> None:
    written.camchain(tmp_path / "chain.yaml")
    ageing = "calibration: {stability: {ageing: {yaw: {standard_deviation: 0.01 deg}}}}"
    loaded = api.load(study(tmp_path, rig=f"from: chain.yaml, {ageing}"))
    with pytest.raises(TradestudyError, match=r"no camera of the study has this name: head \(allowed: rig"):
        api.export(loaded, "head", tmp_path / "out")
    with pytest.raises(TradestudyError, match=r"unknown format: matlab .allowed: .*posterior"):
        api.export(loaded, "rig", tmp_path / "out", formats=("matlab",))
    with pytest.raises(TradestudyError, match=r"posterior.*ageing_yaw.*give --lossy .*, or choose --format mrcal or "):
        api.export(loaded, "rig", tmp_path / "out")
    assert not (tmp_path / "out").exists()
    _, left_out = api.export(loaded, "rig", tmp_path / "out", lossy=True)
    assert [one for one in left_out if re.match("a posterior .* ageing_yaw", one)]


def test_an_export_that_would_write_nothing_is_refused_even_if_losses_are_accepted(tmp_path: Path) -> None:
    sensor = "lenses: {focal_length: 2 mm}, sensor: {pixels: [640, 480], pixel_pitch: 3 um}"
    lens = "distortion: {model: fov, w: 50 deg}"
    loaded = api.load(study(tmp_path, rig=f"kind: stereo, baseline: 60 mm, {sensor}, {lens}"))
    with pytest.raises(TradestudyError, match=r"mrcal.* fov; choose --format kalibr; nothing was written"):
        api.export(loaded, "rig", tmp_path / "out", formats=("mrcal",), lossy=True)
    assert not (tmp_path / "out").exists()
    paths, _ = api.export(loaded, "rig", tmp_path / "out", lossy=True)
    assert [path.name for path in paths] == ["rig-camchain.yaml"]
