"""Options that are written from a study give the same study again, hash by hash."""

from __future__ import annotations

from pathlib import Path

import pytest

from tradestudy.api import Study, load
from tradestudy.errors import StudyError
from tradestudy.study import writing
from tradestudy.study.definition import StudyDefinition

STUDIES = Path(__file__).parents[2] / "studies"


def options(definition: StudyDefinition) -> tuple[str, ...]:
    return writing.options(definition.document, definition.tolerance)


def again(path: Path, found: tuple[str, ...]) -> Study:
    pairs = list(zip(found[::2], found[1::2], strict=True))
    assert {name for name, _ in pairs} <= {"--set", "--tolerance"}
    tolerances = [value for name, value in pairs if name == "--tolerance"]
    return load(path, [value for name, value in pairs if name == "--set"], tolerance=next(iter(tolerances), None))


@pytest.mark.parametrize(
    ("study", "values", "tolerance"),
    [
        ("plenoptic_vs_stereo", ["stereo-short.baseline=50 mm"], "1 %"),
        ("plenoptic_vs_stereo", ["title='it''s: a test # 1'", "question='12'", "accuracy.tolerance=10 %"], None),
        ("close_range", ["scene.picture.texture.contrast={value: 20 %, basis: measured, note: 'it''s new'}"], None),
        ("close_range", ["requirements=null", "pair-f22.lenses.f_number=1.60e1"], "10 %"),
        ("close_range", ["scene.distances={from: 43 mm, to: 70 mm, points: 20, spacing: linear}"], None),
        ("light_spot", [], "10 %"),
        ("light_spot", ["light_spot.tolerance=10 %"], "10 %"),
        ("light_spot", ["light_spot.tolerance=3 %"], "2 %"),
        ("light_spot", ["accuracy.tolerance=10 %", "light_spot.tolerance=3 %"], None),
        ("calibration", [], "10 %"),
        ("calibration", ["accuracy.tolerance=3 %"], None),  # the study's own depth_uncertainty stays
    ],
)
def test_the_study_is_the_same_again(study: str, values: list[str], tolerance: str | None) -> None:
    path = STUDIES / f"{study}.yaml"
    given = load(path, values, tolerance=tolerance)
    assert given.hash != load(path).hash
    assert again(path, options(given.definition)).hash == given.hash


def test_an_unchanged_study_needs_no_options() -> None:
    assert options(load(STUDIES / "close_range.yaml").definition) == ()


def test_a_tolerance_is_one_option_whatever_it_overrides() -> None:
    finer = ["accuracy.depth_uncertainty=3 %"]
    given = load(STUDIES / "calibration.yaml", finer, tolerance="10 %").definition
    assert given.file.accuracy.asked().tolerances["depth_uncertainty"] == 0.1
    assert options(given) == ("--set", *finer, "--tolerance", "10 %")


def test_pictures_that_a_tolerance_loosens_need_no_option_of_their_own() -> None:
    given = load(STUDIES / "light_spot.yaml", tolerance="10 %")
    assert len(given.definition.under_tolerance.overrides) == 2
    assert options(given.definition) == ("--tolerance", "10 %")
    finer = load(STUDIES / "light_spot.yaml", ["light_spot.tolerance=3 %"], tolerance="2 %")
    assert options(finer.definition) == ("--set", "light_spot.tolerance=3 %", "--tolerance", "2 %")


def test_an_invalid_tolerance_is_reported_where_it_was_given() -> None:
    with pytest.raises(StudyError) as error:
        load(STUDIES / "close_range.yaml", tolerance="300 %")
    (problem,) = error.value.problems
    assert (problem.file, problem.path) == ("--tolerance", "accuracy.tolerance")
