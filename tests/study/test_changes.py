"""Values laid over a valid study: what is validated anew is what a whole validation finds, and the rest is shared."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests.study.conftest import STUDIES
from tradestudy.api import Study, load
from tradestudy.errors import Problem, StudyError
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import Override
from tradestudy.study.edits import with_values
from tradestudy.study.prepared import PreparedStudy
from tradestudy.study.schema.root import StudyFile
from tradestudy.study.schema.validation import validate
from tradestudy.study.varying import sweep_axes, sweep_points


def variants(study: PreparedStudy) -> Iterator[StudyDefinition]:
    designs = sweep_points(study, sweep_axes(study))[::20]
    yield from (one.definition for one in (*study.readings.values(), *designs))


@pytest.mark.parametrize("path", sorted(STUDIES.glob("*.yaml")), ids=lambda path: path.stem)
def test_every_variant_equals_its_full_validation(path: Any) -> None:
    for one in variants(load(path).prepared):
        assert one.declared == validate(one.document, StudyFile)
        whole = StudyDefinition.of(one.document)
        assert one.designs == whole.designs
        assert one.posterior_keys == whole.posterior_keys


@pytest.mark.parametrize(
    "values",
    [
        {"accuracy.tolerance": "2 %"},  # of which the study says nothing
        {"usable_range": {"overlap": "70 %"}},
        {"usable_range": None, "readings": None},
        {"raytrix-r5": {"kind": "conventional"}},
        {"scene.distances": ["1 m", "2 m"], "title": "Another"},
        {"cameras.third": {"title": "Third"}},
        {"solve.yaw-at-half-metre": None},
        {"decision.between": ["raytrix-r5", "nobody"]},
        {"stereo-short.baseline": "20"},
        {"stereo-short.depth": {"disparity_error": "derived"}},
        {"nowhere.at.all": 1},
    ],
)
def test_a_part_that_is_added_removed_or_replaced_is_treated_as_in_a_file(
    headline: Study, values: dict[str, Any]
) -> None:
    def answer(make: Callable[[], StudyDefinition]) -> StudyFile | list[Problem]:
        try:
            return make().declared
        except StudyError as error:
            return error.problems

    document = with_values(headline.definition.document, values)
    changed = answer(lambda: headline.definition.with_values(values))
    assert changed == answer(lambda: StudyDefinition.of(document))


@pytest.mark.parametrize(
    ("first", "second", "says"),
    [
        (("stereo-short.baseline", "50 mm"), ("cameras.stereo-short.baseline", "60 mm"), "is set twice"),
        (("stereo-short", {"baseline": "50 mm"}), ("stereo-short.baseline", "60 mm"), "overlaps cameras.stereo-short,"),
        (("stereo-short.baseline", "50 mm"), ("cameras.stereo-short", {"baseline": "60 mm"}), "overlaps cameras.ster"),
    ],
)
def test_no_value_replaces_another_that_is_set_with_it(
    headline: Study, first: tuple[str, Any], second: tuple[str, Any], says: str
) -> None:
    both = dict([first, second])
    path = STUDIES / "plenoptic_vs_stereo.yaml"
    options = [f"{key}={str(value).replace(chr(39), '')}" for key, value in both.items()]
    for mistaken in (lambda: headline.with_values(both), lambda: load(path, options)):
        with pytest.raises(StudyError, match=says):
            mistaken()
    headline.with_values({"stereo-short.baseline": "50 mm", "stereo-short.title": "Rig"})


@pytest.mark.parametrize(
    "option",
    [
        "readings.twice={says: Twice, set: {stereo-short.baseline: 50 mm, cameras.stereo-short.baseline: 60 mm}}",
        "sweep={stereo-short.baseline: [50 mm, 60 mm], cameras.stereo-short.baseline: [40 mm, 70 mm]}",
    ],
)
def test_no_value_of_a_reading_or_sweep_replaces_another(option: str) -> None:
    with pytest.raises(StudyError, match=r"cameras\.stereo-short\.baseline: .*is set twice; omit one"):
        load(STUDIES / "plenoptic_vs_stereo.yaml", [option])


def test_a_camera_that_does_not_change_is_built_once(headline: Study) -> None:
    changed = headline.with_values({"stereo-short.baseline": "30 mm"}).prepared.case.all_cameras
    before = headline.prepared.case.all_cameras
    assert [name for name in before if changed[name] is not before[name]] == ["stereo-short"]
    redder = headline.with_values({"scene.wavelength": "650 nm"}).prepared.case.all_cameras
    assert [name for name in before if redder[name] is before[name]] == []


def test_a_tolerance_stays_whatever_is_changed_under_it() -> None:
    asked = load(STUDIES / "calibration.yaml", tolerance="10 %").definition
    changed = asked.with_values({"scene.wavelength": "600 nm", "accuracy.depth_uncertainty": "3 %"})
    assert set(changed.file.accuracy.asked().tolerances.values()) == {0.1}
    assert changed.tolerance == "10 %"
    assert asked.document.overrides == ()
    assert changed.with_tolerance("5 %").file.accuracy.asked() == asked.with_tolerance("5 %").file.accuracy.asked()


def test_a_looser_tolerance_loosens_pictures_that_are_compared_and_a_tighter_one_leaves_them() -> None:
    study = load(STUDIES / "light_spot.yaml").definition
    own, pictures = study.file.light_spot, ("light_spot", "tolerance")
    assert own is not None
    asked = study.with_tolerance("10 %").with_tolerance("3 %")
    assert asked.file.light_spot is not None
    assert asked.file.light_spot.tolerance == max(own.tolerance, 0.03)
    given = {one.path: one for one in study.with_tolerance("10 %").under_tolerance.overrides}
    assert given[pictures] == Override(path=pictures, text="10 %", before=study.document.text_of(pictures))
