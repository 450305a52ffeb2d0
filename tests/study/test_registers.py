"""What a study rests on, as its report lists it: values set for a run, and inputs that contradict each other."""

from __future__ import annotations

from pathlib import Path

import pytest

from tradestudy import load
from tradestudy.answers.registers import assumptions_group, contradictions
from tradestudy.cameras.camera import Contradiction
from tradestudy.study.starter import starter

CLOSE = Path(__file__).parents[2] / "studies" / "close_range.yaml"
Row = tuple[str, str, str]


def register(*changes: str) -> dict[tuple[str, str], Row]:
    """Value, basis and note by path and cameras."""
    table = assumptions_group(load(CLOSE, list(changes)).prepared)
    columns = [[str(text) for text in table[name].values] for name in ("path", "cameras", "value", "basis", "note")]
    return {(path, cameras): (value, basis, note) for path, cameras, value, basis, note in zip(*columns, strict=True)}


def test_a_value_set_for_a_run_does_not_claim_the_source_of_the_study_s_own() -> None:
    own = register()
    rows = register("pair-f22.lenses.f_number=16")
    key = ("lenses.f_number", "pair-f22")
    assert own[key] == ("22", "assumed", "the smallest stop of a typical iris")
    assert rows[key] == ("16", "set for this run", "replaces 22 (assumed: the smallest stop of a typical iris)")
    assert {path: row for path, row in rows.items() if path != key} == {
        path: row for path, row in own.items() if path != key
    }


@pytest.mark.parametrize(("study", "camera"), [("robot", "raytrix-r5"), ("hand_lens", "r5-unfocused")])
def test_the_step_of_depth_discrimination_is_a_tenth_of_a_pixel_unless_declared(study: str, camera: str) -> None:
    loaded = load(CLOSE.with_name(f"{study}.yaml"), [f"{camera}.depth.discrimination_step=null"]).prepared
    assert loaded.case.all_cameras[camera].discrimination_step_px == 0.1  # type: ignore[attr-defined]
    table = assumptions_group(loaded).to_dataframe().reset_index()
    rows = table[(table["path"] == "depth.discrimination_step") & table["note"].str.contains("default")]
    assert rows[["cameras", "value", "basis"]].values.tolist() == [[camera, "0.1 px", "assumed"]]


def test_values_without_a_basis_and_unlimited_defaults_are_listed(tmp_path: Path) -> None:
    """The starter states no basis for pixels, lenses and wavelength; the added picture none for texture and light."""
    path = tmp_path / "start.yaml"
    path.write_text(starter("start"), encoding="utf-8")
    picture = (
        "{texture: {contrast: 15 %, correlation_length: 1 mm}, matching_window: 9 px, light: {electrons: 4000 "
        "electrons, at_f_number: 4}, read_noise: 5 electrons, full_well: 10000 electrons, bit_depth: 10}"
    )
    path.write_text(path.read_text().replace("  wavelength: 550 nm", f"  wavelength: 550 nm\n  picture: {picture}"))
    table = assumptions_group(load(path).prepared).to_dataframe().reset_index()
    rows = {(row.cameras, row.path): (row.value, row.basis) for row in table.itertuples()}
    assert rows["stereo", "sensor.pixels"] == ("[1024, 1024]", "")
    assert rows["plenoptic", "calibration.correlations.mla_distance.focal_length"] == ("0.9", "")
    assert rows["", "scene.picture.texture.contrast"] == ("15 %", "")
    assert rows["", "scene.picture.light.electrons"] == ("4000 electrons", "")
    assert rows["", "scene.wavelength"] == ("550 nm", "")
    assert rows["", "scene.picture.matcher"] == ("none: errors at the Cramér–Rao bound", "assumed")
    assert rows["stereo", "depth.disparity_error"] == ("0.1 px", "assumed")
    assert rows["stereo", "depth.disparity_range"] == ("unlimited", "assumed")
    unsupported = {path for (_, path), (_, basis) in rows.items() if not basis}
    assert not [one for one in unsupported if one.endswith(("title", "kind")) or "distances" in one]


def test_a_value_shared_by_cameras_is_set_for_the_named_one_alone() -> None:
    rows = register("pair-f9.8.lenses.f_number=7.1")
    note = "replaces 9.8 (datasheet: of MAHLI at 25 mm working distance)"
    assert rows["lenses.f_number", "pair-f9.8"] == ("7.1", "set for this run", note)
    assert rows["lenses.f_number", "pair-declared"] == ("9.8", "datasheet", "of MAHLI at 25 mm working distance")


def test_added_removed_and_annotated_values_are_recorded() -> None:
    rows = register(
        "scene.picture.texture.contrast={value: 20 %, basis: measured, note: on a slab}",
        "pair-f22.attributes.moving_parts=2",
        "requirements=null",
    )
    assert rows["scene.picture.texture.contrast", ""] == (
        "20 % (measured: on a slab)",
        "set for this run",
        "replaces 15 % (assumed: weathered rock under diffuse light)",
    )
    assert rows["attributes.moving_parts", "pair-f22"] == ("2", "set for this run", "the study declares none")
    value, basis, note = rows["requirements", ""]
    assert (value, basis) == ("none", "set for this run")
    assert note.startswith(f"replaces {{grains: {{says: {load(CLOSE).file.requirements['grains'].says}, ")


def test_a_tolerance_is_set_for_the_run_and_a_reading_s_value_is_the_study_s_own() -> None:
    loaded = load(CLOSE, [], tolerance="10 %")
    given = {override.path: override.text for override in loaded.definition.under_tolerance.overrides}
    assert given == {("accuracy", "tolerance"): "10 %", ("accuracy", "depth_noise"): "10 %"}
    headline = load(CLOSE.with_name("plenoptic_vs_stereo.yaml")).prepared
    assert headline.readings
    assert all(not reading.document.overrides for reading in headline.readings.values())


def test_set_values_identify_a_stored_run() -> None:
    same_number = load(
        CLOSE, ["pair-f22.lenses.f_number={value: 22, basis: assumed, note: the smallest stop of a typical iris}"]
    )
    assert same_number.definition.document.tree == load(CLOSE).definition.document.tree
    assert same_number.hash != load(CLOSE).hash  # its register differs


def found(*changes: str) -> list[tuple[str, Contradiction]]:
    declared = [f"cameras.pair-declared.{change}" for change in changes]
    rows = contradictions(load(CLOSE, declared).prepared)
    return [(camera, row) for camera, row in rows if row.what == "principal distance against focus distance"]


def test_lines_of_sight_by_the_focal_length_contradict_a_blur_by_the_focus() -> None:
    assert found() == []
    ((camera, row),) = found("principal_distance=focal_length")
    # f = 18.3 mm at a = 55.3 mm: c = f a/(a − f) = 27.35 mm, longer by 18.3/37.
    assert camera == "pair-declared"
    assert row.stated == "18.3 mm, the focal length"
    assert row.implied.startswith("27.35 mm")
    assert all(part in row.implied for part in ("55.3 mm", "49.5 %"))
    assert all(part in row.used for part in ("18.3 mm", "27.35 mm", "principal_distance: focused"))


@pytest.mark.parametrize(("focus", "named"), [("384 mm", True), ("385 mm", False), ("infinity", False)])
def test_two_scales_within_the_tolerance_are_not_a_contradiction(focus: str, named: bool) -> None:
    """Five percent is 18.3 mm over 366 mm: at 384.3 mm."""
    assert bool(found("principal_distance=focal_length", f"focus_distance={focus}")) == named


def test_lenses_that_refocus_have_no_blur_to_contradict() -> None:
    assert found("principal_distance=focal_length", "focus_distance=autofocus") == []
