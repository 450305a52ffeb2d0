"""`tradestudy render`: what it writes, for whom, and what it refuses."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import tradestudy
from tests.scene_studies import BY_RAYS, PAIR, PLENOPTIC, scene_study
from tests.study.camera_files.written import camchain
from tradestudy import api, cli
from tradestudy.answers import pictures
from tradestudy.errors import StudyError, UnaffordableError
from tradestudy.execution import Checkpoints, Executor, Steps, Threads
from tradestudy.imaging.render import tiles
from tradestudy.imaging.render.tiles import drawn_errors
from tradestudy.optics.arrays import FloatArray

pytestmark = pytest.mark.usefixtures("only_rays")

CAMERAS = (
    PAIR.format(
        name="pair", title="Pair", pixels="[160, 100]", baseline="20 mm", convergence="infinity", error="0.1 px"
    )
    + "    calibration: {errors: {yaw: {standard_deviation: 0.5 deg}}}\n"
    + PLENOPTIC.format(pixels="[192, 192]", estimator="same-type-pair", lenses="")
)
PLANE = "{shape: plane, distance: 150 mm}"
STEP = "{shape: step, near: 130 mm, far: 170 mm}"


def study(folder: Path, surfaces: str = PLANE, *more: str, effects: str = BY_RAYS) -> api.Study:
    path = folder / "small.yaml"
    text = scene_study(
        CAMERAS,
        surfaces,
        distances="from: 100 mm, to: 200 mm, points: 5",
        window="7 px",
        light="at_f_number: 8, at_pixel_pitch: 10 um",
        more="\n    ".join(more),
        effects=effects,
    )
    path.write_text(text, encoding="utf-8")
    return api.load(path)


def rendered(folder: Path, loaded: api.Study, executor: Executor | None = None) -> dict[str, FloatArray]:
    """Pictures and depths by camera and name."""
    api.render(loaded, folder, executor=executor)
    files = sorted((folder / "pictures").glob("*/*.*"))
    return {
        f"{path.parent.name}/{path.stem}": np.asarray(Image.open(path))
        for path in files
        if path.suffix in (".png", ".tiff")
    }


def facts(folder: Path, camera: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "pictures" / camera / "camera.json").read_text(encoding="utf-8"))
    return found


def test_a_picture_has_the_light_of_the_exposure_of_its_camera(tmp_path: Path) -> None:
    usual = study(tmp_path, PLANE, "noise: 'off'")
    longer = usual.with_values({"cameras.pair.sensor.relative_exposure": 2.5})
    before, after = (rendered(tmp_path / name, one) for name, one in (("usual", usual), ("longer", longer)))
    np.testing.assert_allclose(after["pair/left"], 2.5 * before["pair/left"], rtol=1e-6)
    np.testing.assert_array_equal(after["plenoptic/raw"], before["plenoptic/raw"])
    # Pixels of 10 um at the working f-number 8 (1 + m) collect 8000 electrons, less where cos⁴ falls off.
    middle = before["pair/left"][40:60, 70:90]
    magnification = 8.0 / (150.0 - 8.0)
    assert np.mean(middle) == pytest.approx(8000.0 / (1.0 + magnification) ** 2, rel=0.1)


def test_writes_pictures_depths_and_cameras(tmp_path: Path) -> None:
    found = rendered(tmp_path, study(tmp_path))
    assert sorted(found) == [
        "pair/left",
        "pair/left_depth",
        "pair/right",
        "pair/right_depth",
        "plenoptic/raw",
        "plenoptic/raw_depth",
    ]
    assert found["pair/left"].shape == (100, 160)
    assert found["pair/left"].dtype == found["plenoptic/raw"].dtype == np.uint16
    assert found["pair/left_depth"] == pytest.approx(0.15, rel=1e-6)
    raw = found["plenoptic/raw_depth"]
    assert raw[np.isfinite(raw)] == pytest.approx(0.15, rel=1e-6)
    camera = facts(tmp_path, "plenoptic")
    picture = camera["pictures"]["raw"]
    assert camera["depth"]["unit"] == "m"
    assert 0 < picture["sampling_error"] < 0.02
    assert picture["array_to_sensor"] == pytest.approx(0.568e-3, rel=0.02)
    # Digital numbers are electrons over the step; on the axis as many as the light promises at f/N with N = b/A.
    left = facts(tmp_path, "pair")
    n = left["pictures"]["left"]["lens_to_sensor"] / left["pictures"]["left"]["pupil_diameter"]
    mean = found["pair/left"].mean() * left["values"]["electrons_per_number"]
    assert mean == pytest.approx(8000 * (8 / n) ** 2, rel=0.05)


def test_returns_the_arrays_that_it_writes(tmp_path: Path) -> None:
    scene = tradestudy.render(study(tmp_path), str(tmp_path / "out"))
    arrays = {f"{camera}/{name}": one for camera, own in scene.arrays.items() for name, one in own.items()}
    files = {path.stem: path for path in (tmp_path / "out" / "pictures").glob("*/*.*") if path.suffix != ".json"}
    assert sorted(arrays) == [
        "pair/left", "pair/left_depth", "pair/right", "pair/right_depth", "plenoptic/raw", "plenoptic/raw_depth",
    ]  # fmt: skip
    for name, one in arrays.items():
        path = files[name.rpartition("/")[2]]
        np.testing.assert_array_equal(one, np.load(path) if path.suffix == ".npy" else np.asarray(Image.open(path)))
    assert repr(scene) == "RenderedScene(pair: left, left_depth, right, right_depth; plenoptic: raw, raw_depth)"


def test_the_near_side_of_a_step_hides_the_far_one(tmp_path: Path) -> None:
    """From the left, the near tread stands before a strip of the far one; from the right the riser is seen."""
    found = rendered(tmp_path, study(tmp_path, STEP, "cameras: [pair]", "depth_format: tiff"))
    c = 1 / (1 / 8e-3 - 1 / 0.15)
    column = (np.arange(160) + 0.5 - 80) * 10e-6 / c  # slopes
    for side, x in (("left", -0.01), ("right", 0.01)):
        depth = found[f"pair/{side}_depth"]
        assert np.all(depth == depth[:1])
        edge, end = -x / 0.13, -x / 0.17
        far = end if x > 0 else edge  # from here on the far tread
        pixel = 10e-6 / c
        assert depth[0, column < edge - pixel] == pytest.approx(0.13, rel=1e-6)
        assert depth[0, column > far + pixel] == pytest.approx(0.17, rel=1e-6)
        if x > 0:
            riser = (column > edge + pixel) & (column < end - pixel)
            assert riser.sum() > 5
            assert depth[0, riser] == pytest.approx(-x / column[riser], rel=1e-4)


@pytest.mark.parametrize("first_row", ["top", "bottom"])
def test_pictures_stand_upright_and_are_not_mirrored(tmp_path: Path, first_row: str) -> None:
    """A wall that is bright in one corner, on a map with a near corner."""
    depth, bright = np.full((64, 64), 150, np.uint16), np.full((64, 64), 60, np.uint8)
    depth[:32, 32:], bright[:32, 32:] = 140, 240  # first rows, to the right
    Image.fromarray(depth).save(tmp_path / "depth.png")
    Image.fromarray(bright).save(tmp_path / "bright.png")
    depth_map = "shape: depth-map, depth: depth.png, unit: 1 mm, width: 60 mm, picture: bright.png"
    surface = f"{{{depth_map}, first_row: {first_row}}}"
    found = rendered(tmp_path, study(tmp_path, surface))
    right = slice(1, 2)
    row = slice(0, 1) if first_row == "top" else slice(1, 2)
    for name in ("pair/left", "pair/right", "plenoptic/raw"):
        picture = found[name].astype(float)
        rows, columns = picture.shape
        quarters = picture.reshape(2, rows // 2, 2, columns // 2).mean(axis=(1, 3))
        depths = np.nan_to_num(found[f"{name}_depth"], nan=0.15).reshape(2, rows // 2, 2, columns // 2)
        if name == "plenoptic/raw":
            assert quarters[row, right] > 1.5 * np.median(quarters)
        else:
            assert quarters[row, right] > 1.3 * np.median(quarters)
        assert depths.mean(axis=(1, 3))[row, right] < np.median(depths) - 0.002


def test_results_do_not_depend_on_the_executor(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiles, "TILE", (50, 64))
    smaller = {"cameras.pair.sensor.pixels": [128, 100], "cameras.plenoptic.sensor.pixels": [128, 128]}
    loaded = study(tmp_path, "{shape: rock, near: 140 mm, far: 160 mm, feature_size: 10 mm}", "rig: drawn").with_values(
        smaller
    )
    alone = rendered(tmp_path / "alone", loaded)
    shared = rendered(tmp_path / "shared", loaded, Threads(3))
    for name, picture in alone.items():
        assert np.array_equal(picture, shared[name], equal_nan=True), name
    assert not np.array_equal(alone["pair/left"][:50, :64], alone["pair/left"][50:, :64])


def test_an_interrupted_rendering_is_resumed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tiles, "TILE", (50, 64))
    loaded = study(tmp_path)
    counts = []
    for stop in (True, False):
        checkpoints = Checkpoints(tmp_path / "out")

        def progress(_step: str, share: float, stop: bool = stop) -> None:
            if stop and share > 0.5:
                raise KeyboardInterrupt

        steps = Steps(checkpoints=checkpoints, progress=progress)
        try:
            pictures.render_scene(loaded.prepared, steps)
        except KeyboardInterrupt:
            assert stop
        checkpoints.close()
        counts.append(steps.counts["rendering"])
    assert counts[1]["taken up"] == counts[0]["computed"] > 0
    assert counts[1]["computed"] > 0


def test_a_drawn_rig_moves_the_picture_by_its_yaw(tmp_path: Path) -> None:
    plain = study(tmp_path, PLANE, "cameras: [pair]", "noise: off")
    drawn = study(tmp_path, PLANE, "cameras: [pair]", "noise: off", "rig: drawn")
    first, second = rendered(tmp_path / "plain", plain), rendered(tmp_path / "drawn", drawn)
    yaw = facts(tmp_path / "drawn", "pair")["errors"]["yaw"]
    assert yaw != 0.0
    assert facts(tmp_path / "plain", "pair")["errors"] == {}
    assert np.array_equal(first["pair/left"], second["pair/left"])
    # A yaw towards the left camera shows the scene farther to the right, by c ψ in the middle.
    middle = slice(60, 100)
    a, b = (one["pair/right"][40:60].mean(axis=0) for one in (first, second))
    shifts = np.arange(-12, 13)
    best = shifts[np.argmin([np.std(b[60 + k : 100 + k] - a[middle]) for k in shifts])]
    c = 1 / (1 / 8e-3 - 1 / 0.15)
    assert best == pytest.approx(c * np.tan(yaw) / 10e-6, abs=1.0)


def test_a_drawn_rig_with_a_calibrated_geometry_is_refused_at_its_place(tmp_path: Path) -> None:
    camchain(tmp_path / "chain.yaml")
    rig = "  rig:\n    from: chain.yaml\n    calibration: {errors: {yaw: {standard_deviation: 0.5 deg}}}\n"
    study(tmp_path, PLANE, "rig: drawn")
    path = tmp_path / "small.yaml"
    path.write_text(path.read_text().replace("cameras:\n", "cameras:\n" + rig, 1))
    with pytest.raises(StudyError, match=r"small\.yaml:\d+:\d+: scene\.image\.rig: .*pictures of rig, .*imported"):
        api.render(api.load(path), tmp_path)


def test_a_drawn_rig_has_correlated_errors_once_and_scatter_for_every_microlens(tmp_path: Path) -> None:
    loaded = study(tmp_path, PLANE, "rig: drawn").with_values(
        {
            "plenoptic.calibration.errors.mla_distance.standard_deviation": "1 um",
            "plenoptic.calibration.errors.focal_length.standard_deviation": "1 um",
            "plenoptic.calibration.errors.microlens_center_scatter.standard_deviation": "0.1 um",
            "plenoptic.calibration.correlations.mla_distance.focal_length": "0.9",
        }
    )
    camera: Any = loaded.prepared.case.cameras["plenoptic"]
    drawn = [drawn_errors(camera, "plenoptic", seed) for seed in range(400)]
    z, f = (np.array([float(one[name]) for one in drawn]) for name in ("mla_distance", "focal_length"))
    assert np.corrcoef(z, f)[0, 1] == pytest.approx(0.9, abs=0.04)
    assert np.std(z) == pytest.approx(1e-6, rel=0.1)
    scatter = drawn[0]["microlens_center_scatter"]
    assert scatter.shape == (camera.elements, 2)
    assert np.std(scatter) == pytest.approx(1e-7, rel=0.1)


def test_without_noise_electrons_are_written_as_floats(tmp_path: Path) -> None:
    loaded = study(tmp_path, PLANE, "noise: off", "depth_format: npy", "cameras: [plenoptic]")
    written = api.render(loaded, tmp_path).pictures
    assert [path.name for path in written] == ["raw.tiff"]
    assert np.asarray(Image.open(written[0])).dtype == np.float32
    assert np.load(tmp_path / "pictures" / "plenoptic" / "raw_depth.npy").shape == (192, 192)


def test_pictures_beyond_the_free_memory_are_refused_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "available_memory", lambda: 1e8)
    with pytest.raises(UnaffordableError, match=r"192 × 192 pixels: 0\.\d GB on 1 worker .*0\.1 GB free"):
        api.render(study(tmp_path), tmp_path)
    assert not (tmp_path / "pictures").exists()


def test_a_study_without_a_scene_to_render_says_so(tmp_path: Path) -> None:
    headline = Path(__file__).parents[1] / "studies" / "robot.yaml"
    answer = CliRunner().invoke(cli.app, ["render", str(headline), "--out", str(tmp_path)])
    assert answer.exit_code == 2
    assert "scene.image: this key is missing" in answer.output


@pytest.mark.parametrize(
    ("surfaces", "more", "message"),
    [
        ("{shape: step, near: 170 mm, far: 130 mm}", "", "scene.image.surfaces.0.far: must lie beyond near"),
        (PLANE, "cameras: [pear]", "scene.image.cameras.0: no camera is called 'pear'; nearest: 'pair'"),
        ("{shape: cube, distance: 1 m}", "", "scene.image.surfaces.0"),
        (PLANE, "samples: 2", "scene.image.samples"),
    ],
)
def test_mistakes_are_reported_at_their_place(tmp_path: Path, surfaces: str, more: str, message: str) -> None:
    with pytest.raises(StudyError) as refused:
        study(tmp_path, surfaces, more)
    assert message in str(refused.value)


def test_a_missing_map_is_reported_at_its_place(tmp_path: Path) -> None:
    surface = "{shape: depth-map, depth: nowhere.png, unit: 1 mm, first_row: top, width: 60 mm}"
    loaded = study(tmp_path, surface)
    with pytest.raises(StudyError, match=r"scene.image.surfaces.0.depth: .*nowhere.png"):
        api.render(loaded, tmp_path)


def test_more_samples_lower_the_error(tmp_path: Path) -> None:
    loaded = study(tmp_path, PLANE, "cameras: [plenoptic]")
    definition = loaded.prepared
    image, picture = pictures.declared_image(definition)
    scene, (camera,) = pictures.set_up(definition)
    tile = tiles.Tile(
        camera="plenoptic",
        exposure=camera.exposures[0],
        scene=scene,
        recording=pictures.recording_of(image, picture, camera.camera.sensor),
        samples=1024,
        seed=0,
        rows=(80, 112),
        columns=(80, 112),
    )
    exact, _ = tiles.expected_electrons(tile)
    errors = []
    for samples in (8, 32, 128):
        light, _ = tiles.expected_electrons(replace(tile, samples=samples))
        errors.append(np.linalg.norm(light - exact) / np.linalg.norm(exact))
    assert errors[0] < 0.01
    assert errors[2] < 0.6 * errors[1] < 0.6 * 0.9 * errors[0]
