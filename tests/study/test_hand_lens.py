"""The hand-lens study answers sections 2, 3 and 7 of the paper as published figures and plain arithmetic must."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tests.study.conftest import STUDIES
from tradestudy.answers.depth_of_field import criteria_group
from tradestudy.answers.registers import contradictions
from tradestudy.api import Result, load
from tradestudy.errors import StudyError
from tradestudy.results import GROUPS, storage
from tradestudy.results.views.groups import records

DEPTH_CAMERAS = {
    "r5-one-type",
    "r5-three-types",
    "r5-set-for-rock",
    "r5-one-type-for-rock",
    "r5-unfocused",
    "stereo",
}


@pytest.fixture(scope="module")
def result(run_of: Callable[..., Result]) -> Result:
    return run_of("hand_lens", "scene.distances.points=93")


@pytest.fixture(scope="module")
def focus(result: Result) -> xr.Dataset:
    return result.data["depth_of_field"].to_dataset()


@pytest.fixture(scope="module")
def criteria(result: Result) -> xr.Dataset:
    return result.data["criteria"].to_dataset()


def value(result: Result, claim: str, reading: str) -> float:
    return float(result.data["claims"].to_dataset()["value"].sel(claim=claim, reading=reading))


def verdict(result: Result, claim: str) -> str:
    return str(result.data["claims"].to_dataset()["verdict"].sel(claim=claim).item())


# ---- the paper's sentences ------------------------------------------------------------------------------------------


def test_0_82_mm_belongs_to_22_5_millimetres_and_not_to_centimetres(result: Result) -> None:
    # At 22.5 mm the scale is 14.5 µm on 7.4 µm pixels; 2 N c a (a − f)/f² to first order in c.
    a = 18.3e-3 * (1 + 14.5 / 7.4)
    assert value(result, "H2", "as declared") == pytest.approx(
        2 * 9.8 * 7.4e-6 * a * (a - 18.3e-3) / 18.3e-3**2, rel=1e-3
    )
    assert value(result, "H2", "as declared") == pytest.approx(0.84e-3, abs=5e-6)
    assert verdict(result, "H2") == "met"
    # Published for 22.5 cm: 16 to 26 mm by the focal length taken.
    assert value(result, "H1", "centimetres") == pytest.approx(26e-3, abs=1e-3)
    assert 16e-3 < value(result, "H1", "centimetres-far-lens") < 19e-3
    assert verdict(result, "H1") == "not met"


def test_many_times_deeper_at_equal_blur_but_not_at_equal_resolution(result: Result) -> None:
    # 150 mm to the end of the range over 5.5 mm; at 147 µm the conventional camera has 2 · 150 mm · 0.147/3.289.
    assert value(result, "H3", "as declared") == pytest.approx((250 - 150) / 5.52, rel=2e-3)
    conventional = 2 * 0.150 * 147e-6 * 3.8 / 12.5e-3
    assert value(result, "H4", "as declared") * conventional == pytest.approx(17.9e-3, abs=0.2e-3)
    assert verdict(result, "H3") == "met"
    # Stopped down to f/11 the conventional camera is the deeper one.
    assert value(result, "H4", "stopped-down") == pytest.approx(value(result, "H4", "as declared") * 3.8 / 11, rel=1e-9)
    assert verdict(result, "H4") == "cannot be decided from its source"


# ---- what is sharp --------------------------------------------------------------------------------------------------


def ends(focus: xr.Dataset, camera: str, sharp: str = "one-pixel") -> tuple[float, float]:
    one = focus.sel(camera=camera, sharp=sharp)
    return float(one["sharp_near"][0]), float(one["sharp_far"][0])


def test_published_ranges_of_the_r5(focus: xr.Dataset) -> None:
    near, far = ends(focus, "r5-three-types")
    assert near == pytest.approx(0.150, rel=1e-9)
    assert far == math.inf
    assert ends(focus, "r5-one-type") == pytest.approx((0.150, 0.187), abs=0.5e-3)
    np.testing.assert_allclose(
        focus["slice_near"].sel(camera="r5-three-types", sharp="one-pixel").values[:3],
        [0.150, 0.187, 0.307],
        atol=0.5e-3,
    )
    assert ends(focus, "r5-no-microlenses") == pytest.approx((0.1473, 0.1528), abs=0.1e-3)


def test_which_camera_keeps_the_rock_sharp_with_what(focus: xr.Dataset, criteria: xr.Dataset) -> None:
    first = focus.sel(sharp="one-pixel")
    keeps = {str(name) for name in first["camera"].values if float(first["scene_share"].sel(camera=name)) == 1.0}
    assert keeps == {"mahli-stack", "r5-set-for-rock", "r5-one-type-for-rock", "r5-unfocused", "stereo"}
    moving = criteria["number"].sel(criterion="moving parts")
    assert {str(name) for name in moving["camera"].values if moving.sel(camera=name) > 0} == {
        "mahli",
        "mahli-stack",
        "mahli-contact",
    }
    # MAHLI's depth of field at 150 mm is 8.6 mm: three of them for 20 mm.
    assert int(first["images"].sel(camera="mahli-stack")) == math.ceil(20 / 8.6)
    # Resolution on the far end of the rock: a pixel at its magnification.
    stack = float(first["scene_resolution"].sel(camera="mahli-stack"))
    assert stack == pytest.approx(7.4e-6 * (160 - 18.3) / 18.3, rel=0.02)
    unfocused = float(first["scene_resolution"].sel(camera="r5-unfocused"))
    assert unfocused == pytest.approx(126.5e-6 * 160 / 13.636, rel=1e-3)


def test_diffraction_alone_exceeds_one_pixel_of_every_camera_but_the_unfocused_one(focus: xr.Dataset) -> None:
    airy = focus.sel(sharp="one-pixel-airy")
    for name in airy["camera"].values:
        blind = float(airy["extent"].sel(camera=name)) == 0.0
        assert blind == (name != "r5-unfocused")
        assert blind == ("exceeds the blur criterion" in str(airy["reason"].sel(camera=name).item()))


def test_sharp_stretches_are_where_every_camera_resolves_its_sample(focus: xr.Dataset) -> None:
    """Wherever one pixel of blur is sharp the sample is larger than the blur; elsewhere blur is larger.

    The Airy radius 1.22 λ a/A counts too: it exceeds the 7.4 µm pixels of MAHLI at f/9.8, not those of the R5 at f/3.8.
    """
    distance = focus["distance"].values
    lens = {"mahli": (18.3e-3, 7.4e-6, 9.8), "r5-no-microlenses": (12.5e-3, 5.5e-6, 3.8)}
    for name, (f, pixel, f_number) in lens.items():
        image = 1 / (1 / f - 1 / 0.150)
        near, far = ends(focus, name)
        inside = (distance >= near) & (distance <= far)
        own = focus.sel(camera=name)
        sample, blur, diffraction, size = (
            own[one].values
            for one in (
                "resolution_of_sampling",
                "resolution_of_blur",
                "resolution_of_diffraction",
                "lateral_resolution",
            )
        )
        np.testing.assert_allclose(sample, pixel * distance / image, rtol=1e-9)
        np.testing.assert_array_equal(blur <= sample, inside)
        np.testing.assert_allclose(diffraction, 1.219669891 * 550e-9 * distance * f_number / f, rtol=1e-9)
        np.testing.assert_array_equal(size, np.max([sample, blur, diffraction], axis=0))
        assert (diffraction > sample).all() == (name == "mahli")


def test_microlenses_that_see_a_point(focus: xr.Dataset) -> None:
    # 0.907 v² at |v| = 2, with the disc z/b larger than |v|/2 pitches (1.083 of them).
    seeing = focus["microlenses_seeing"].sel(camera="r5-three-types").sel(distance=0.150, method="nearest")
    assert float(seeing) == pytest.approx(math.pi * 1.083**2 / (math.sqrt(3) / 2), rel=0.02)
    assert float(focus["total_covering_plane"].sel(camera="r5-three-types")) == pytest.approx(0.150, rel=1e-9)
    assert np.isnan(focus["microlenses_seeing"].sel(camera="stereo").values).all()


def test_equal_resolution_is_stated_for_every_camera(focus: xr.Dataset) -> None:
    assert focus.attrs["equal_resolution"] == 160e-6
    mahli = focus.sel(camera="mahli")
    pupil = 18.3e-3 / 9.8
    assert float(mahli["resolved_near"][0]) == pytest.approx(0.150 * (1 - 160e-6 / pupil), rel=1e-9)
    assert float(mahli["resolved_far"][0]) == pytest.approx(0.150 * (1 + 160e-6 / pupil), rel=1e-9)


# ---- trade criteria -------------------------------------------------------------------------------------------------


def number(criteria: xr.Dataset, camera: str, criterion: str) -> float:
    return float(criteria["number"].sel(camera=camera, criterion=criterion))


def test_strip_hidden_beside_a_step_and_foreshortening(criteria: xr.Dataset) -> None:
    # h B/Z for 10 mm at 150 mm: published for a pupil of 3.3 mm as 0.22 mm; 20 mm of baseline give 1.33 mm.
    assert number(criteria, "r5-three-types", "hidden beside a step") == pytest.approx(0.22e-3, abs=2e-6)
    assert number(criteria, "stereo", "hidden beside a step") == pytest.approx(10e-3 * 20 / 150, rel=1e-12)
    # At 45° the two views see (1 ∓ B/2Z) of the patch.
    assert number(criteria, "stereo", "foreshortening") == pytest.approx((1 - 10 / 150) / (1 + 10 / 150), rel=1e-12)
    assert math.isnan(number(criteria, "mahli", "hidden beside a step"))


def test_data_light_and_size(criteria: xr.Dataset) -> None:
    assert number(criteria, "mahli-stack", "data per depth map") == 3 * 1600 * 1200 * 8
    assert number(criteria, "stereo", "data per depth map") == 2 * 1024**2 * 8
    assert "no depth map" in str(criteria["value"].sel(camera="mahli", criterion="data per depth map").item())
    assert number(criteria, "mahli-stack", "time per scene") == 3 * 5.0
    # A small pupil: π (A/2)²/a².
    assert number(criteria, "r5-three-types", "light gathered") == pytest.approx(
        math.pi * (12.5e-3 / 3.8 / 2 / 0.150) ** 2, rel=1e-3
    )
    assert number(criteria, "stereo", "light gathered") == pytest.approx(2 * math.pi * (0.5e-3 / 0.150) ** 2, rel=1e-3)
    size = str(criteria["value"].sel(camera="stereo", criterion="size").item())
    assert "34.5 mm" in size  # 20 mm of baseline and the 14.5 mm diagonal of a sensor


def test_declared_values_have_their_basis(criteria: xr.Dataset) -> None:
    basis = criteria["basis"].sel(criterion="moving parts")
    assert str(basis.sel(camera="mahli").item()) == "datasheet"
    assert str(basis.sel(camera="stereo").item()) == "derived"


# ---- the study as a whole -------------------------------------------------------------------------------------------


def test_results_are_as_declared_and_survive_their_file(result: Result, tmp_path: Path) -> None:
    assert set(result.data["depth"].to_dataset()["camera"].values) == DEPTH_CAMERAS
    assert len(result.data["cameras"].to_dataset()["camera"]) == 10
    for name in ("depth_of_field", "criteria"):
        group = result.data[name].to_dataset()
        assert set(group.data_vars) <= set(GROUPS[name])
        assert all("units" in group[one].attrs and group[one].attrs["long_name"] for one in group.data_vars)
    storage.write_finished(storage.encoded(result.data), result.run_record, tmp_path)
    again, _ = storage.read_finished(tmp_path)
    for name in ("depth_of_field", "criteria"):
        xr.testing.assert_equal(again[name].to_dataset(), result.data[name].to_dataset())


def test_mismatched_f_numbers_and_fill_factor_are_reported(result: Result) -> None:
    rows = result.data["contradictions"].to_dataset()
    mine = rows.isel(contradiction=np.flatnonzero(rows["camera"].values == "r5-unfocused"))
    assert [str(what) for what in mine["what"].values] == ["f-number matching of microlenses and main lens"]
    assert "f/4.15" in str(mine["stated"].item())  # 13.636 mm over 3.289 mm
    assert "f/3.42" in str(mine["implied"].item())  # 0.432 mm over 126.5 µm
    properties = {
        one["property_name"]: (one["property_value"], one["property_units"])
        for one in records(result.data, "cameras", "property")
        if one["property_camera"] == "r5-unfocused"
    }
    fill, wide, apart = (
        properties[name] for name in ("fill factor of the array", "width of a microlens", "microlens pitch")
    )
    assert fill == (pytest.approx(np.pi / (2.0 * np.sqrt(3.0)) * (113.7 / 126.5) ** 2, rel=1e-3), "1")
    assert (wide, apart) == ((pytest.approx(113.7e-6, rel=1e-3), "m"), (pytest.approx(126.5e-6), "m"))


def test_a_contradicted_depth_of_field_is_reported() -> None:
    study = load(
        STUDIES / "hand_lens.yaml",
        [
            "scene.distances.points=3",
            "mahli-contact.focus.working_distance=22.5 cm",
            "r5-no-microlenses.stated={hyperfocal_distance: 4 m}",
        ],
    )
    rows = contradictions(study.prepared)
    found = {camera: row for camera, row in rows if "depth of field" in row.what}
    assert set(found) == {"mahli-contact"}
    assert found["mahli-contact"].stated == "820 µm"
    assert found["mahli-contact"].implied.startswith("26.")
    hyperfocal = [(camera, row) for camera, row in rows if "hyperfocal" in row.what]
    assert [camera for camera, _ in hyperfocal] == ["r5-no-microlenses"]
    assert hyperfocal[0][1].implied.startswith("7.48")  # published: 7.49 m


@pytest.fixture
def studies(tmp_path: Path) -> Path:
    shutil.copytree(STUDIES / "cameras", tmp_path / "cameras")
    shutil.copy(STUDIES / "plenoptic_vs_stereo.yaml", tmp_path)
    shutil.copy(STUDIES / "hand_lens.yaml", tmp_path)
    return tmp_path


def test_the_headline_study_contains_every_kind_of_camera(studies: Path) -> None:
    path = studies / "plenoptic_vs_stereo.yaml"
    text = path.read_text(encoding="utf-8")
    added = "cameras:\n  mahli: {from: cameras/mahli.yaml}\n  unfocused: {from: cameras/r5-unfocused.yaml}\n"
    added += "  stack: {like: mahli, title: Stack, focus: {stack: {from: 100 mm, to: 2 m, images: 8}}}\n"
    path.write_text(text.replace("cameras:\n", added, 1), encoding="utf-8")
    others = ("readings", "claims", "solve", "decision", "requirements")
    quick = ["scene.distances.points=7", *(f"{name}=null" for name in others)]
    data = load(path, quick).run().data
    assert {"mahli", "stack", "unfocused"} <= set(data["cameras"].to_dataset()["camera"].values)
    depth = data["depth"].to_dataset()
    assert "unfocused" in depth["camera"].values
    assert not {"mahli", "stack"} & set(depth["camera"].values)
    alone = load(STUDIES / "plenoptic_vs_stereo.yaml", quick).run().data["depth"].to_dataset()
    shared = depth.sel(camera=alone["camera"].values)
    np.testing.assert_array_equal(shared["depth_uncertainty"].values, alone["depth_uncertainty"].values)


def test_a_study_of_cameras_that_measure_no_depth_has_no_depth(studies: Path) -> None:
    path = studies / "hand_lens.yaml"
    text = re.sub(r"^  (r5-[\w-]+|stereo):\n(?:    .*\n)+", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE)
    text = re.sub(r"^  r5-unfocused: .*\n", "", text, flags=re.MULTILINE)
    path.write_text(text[: text.index("\nreadings:")] + "\n", encoding="utf-8")
    result = load(path, ["scene.distances.points=5"]).run()
    assert set(result.data.children) >= {"cameras", "depth_of_field", "criteria"}
    assert "depth" not in result.data.children
    assert "decision" not in result.data.children


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ("decision={between: [mahli, stereo], at: [150 mm]}", "measures no depth"),
        ("requirements.depth-of-the-rock.camera=mahli", "measures no depth"),
        ("claims.H3.against=mahl", "nearest: 'mahli'"),
        ("claims.H1.reading=centimetre", "nearest: 'centimetres'"),
        ("claims.H4.blur=1 px", "exactly one of blur and resolution"),
        ("claims.H4.diffraction=fwhm", "belongs to blur"),
        ("depth_of_field.range=[160 mm, 140 mm]", "must lie beyond the first"),
        ("relief.surface_tilt=90 deg", "shows only its edge"),
        ("mahli.focus.image_scale=10 um", "exactly one of distance, image_scale and working_distance"),
        ("mahli-contact.focus.reference=null", "focus.working_distance: .*give a reference"),
        ("mahli-stack.focus.stack.to=100 mm", "must lie beyond from"),
        ("mahli.focus.distance=15 mm", "cannot focus that close"),
        ("r5-unfocused.focus.distance=10 mm", "cannot focus that close"),
        ("r5-unfocused.microlenses.aperture_diameter=100 um", "at most one of aperture_diameter and f_number"),
    ],
)
def test_mistakes_are_reported_with_a_remedy(change: str, what: str) -> None:
    with pytest.raises(StudyError, match=what):
        load(STUDIES / "hand_lens.yaml", ["scene.distances.points=3", change])


def test_criteria_need_a_scene() -> None:
    with pytest.raises(StudyError, match="needs depth_of_field"):
        load(STUDIES / "hand_lens.yaml", ["depth_of_field=null"])


def test_the_criteria_and_the_selection_agree_on_what_is_sharp() -> None:
    """With the spot of diffraction the hand lens is nowhere sharp within a pixel; without it, it is."""
    images = []
    for forced in ("airy", "off"):
        plan = load(
            STUDIES / "hand_lens.yaml",
            [
                "depth_of_field.criteria.one-pixel.diffraction=airy-diameter",
                f"effects={{main_lens_diffraction: {forced}}}",
            ],
        ).plan()
        file = plan.study.file
        assert file.relief is not None
        assert file.depth_of_field is not None
        found = criteria_group(plan.study)
        images.append(found["number"].sel(criterion="images per scene").values[1])
    assert not np.array_equal(images[0], images[1], equal_nan=True)
