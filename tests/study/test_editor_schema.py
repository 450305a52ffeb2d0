"""What editors are told about study files, judged by an outside validator on files as they are written."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import jsonschema
import pytest
from ruamel.yaml import YAML

from tradestudy.study.schema.editor import editor_schema
from tradestudy.study.schema.root import StudyFile

HERE = Path(__file__).parent
STUDIES = HERE.parents[1] / "studies"


def complaints(path: Path) -> list[str]:
    validator = jsonschema.Draft202012Validator(editor_schema(StudyFile))
    content: Any = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    return [f"{error.json_path}: {error.message}" for error in validator.iter_errors(content)]


def test_is_a_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(editor_schema(StudyFile))


@pytest.mark.parametrize(
    "path", [*sorted(STUDIES.glob("*.yaml")), HERE / "wrong" / "right.yaml"], ids=lambda path: path.stem
)
def test_accepts_studies_as_they_are_written(path: Path) -> None:
    # A claim may expect a bare number where its schema says text; the model reads both.
    assert complaints(path) == []


@pytest.mark.parametrize(
    ("name", "place"),
    [
        ("unknown_key_at_the_top", "$"),
        ("missing_keys", "$"),
        ("list_for_a_mapping", "$.cameras"),
        ("bare_number_for_a_length", "$.scene"),
        ("another_format", "$.format"),
        ("bad_basis", "$.usable_range.overlap"),
    ],
)
def test_marks_mistakes_where_they_are(name: str, place: str) -> None:
    assert any(complaint.startswith(f"{place}: ") for complaint in complaints(HERE / "wrong" / f"{name}.yaml"))
