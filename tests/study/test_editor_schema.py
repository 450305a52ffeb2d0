"""The schema of study files for editors, checked by an outside validator on files as they are written."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from ruamel.yaml import YAML

from tradestudy.study.schema.editor import editor_schema
from tradestudy.study.schema.root import StudyFile

HERE = Path(__file__).parent
STUDIES = HERE.parents[1] / "studies"


@cache
def schema() -> dict[str, Any]:
    return editor_schema(StudyFile)


def complaints(path: Path) -> list[str]:
    validator = jsonschema.Draft202012Validator(schema())
    content: Any = YAML(typ="safe", pure=True).load(path.read_text(encoding="utf-8"))
    return [f"{error.json_path}: {error.message}" for error in validator.iter_errors(content)]


def test_is_a_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(schema())


@pytest.mark.parametrize(
    "path", [*sorted(STUDIES.glob("*.yaml")), HERE / "wrong" / "right.yaml"], ids=lambda path: path.stem
)
def test_accepts_studies_as_they_are_written(path: Path) -> None:
    # A claim may expect a bare number where its schema says text; the model reads both.
    assert complaints(path) == []


@pytest.mark.parametrize(
    ("files", "fits"),
    [("left.yaml", True), (["left.yaml", "right.yaml"], True), ([1.0], False), (2.0, False), ([], False)],
)
def test_a_camera_comes_from_one_file_or_several(files: Any, fits: bool) -> None:
    content: Any = YAML(typ="safe", pure=True).load((STUDIES / "robot.yaml").read_text(encoding="utf-8"))
    content["cameras"]["mine"] = {"from": files}
    assert jsonschema.Draft202012Validator(schema()).is_valid(content) is fits


@pytest.mark.parametrize(
    ("written", "fits"),
    [
        ({"value": "300 mm", "basis": "measured", "note": "by tape"}, True),
        ({"basis": "measured"}, False),
        ({"value": "300 mm", "basis": "heard"}, False),
        ({"value": "300", "basis": "measured"}, False),
        ({"value": "300 mm", "source": "by tape"}, False),
    ],
)
def test_a_value_with_its_basis_keeps_the_limits_of_both(written: Any, fits: bool) -> None:
    content: Any = YAML(typ="safe", pure=True).load((STUDIES / "robot.yaml").read_text(encoding="utf-8"))
    content["scene"]["distances"]["from"] = written
    assert jsonschema.Draft202012Validator(schema()).is_valid(content) is fits


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


def test_describes_every_key_of_a_study() -> None:
    """An editor shows what stands beside a key or where it refers to; also of ``{value: …, basis: …}``."""
    whole = schema()
    missing = [key for key, below in _keys(whole) if not _described(below, whole["$defs"])]
    assert set(missing) <= {"value"}  # which is what the key itself describes


def test_is_small_enough_for_editors_to_load_at_once() -> None:
    assert len(json.dumps(schema(), indent=1)) < 300_000


def test_says_within_which_limits_a_quantity_lies() -> None:
    parts = schema()["$defs"]
    radius = dict(parts["SpherePart"]["properties"]["radius"])
    while "$ref" in radius:  # what stands beside a reference applies as well
        radius = {**parts[radius.pop("$ref").rpartition("/")[2]], **radius}
    assert radius["description"] == "Radius of the sphere."
    plain = radius["anyOf"][0]
    assert parts[plain["$ref"].rpartition("/")[2]]["title"] == "a length above 0 m"


def _keys(below: Any) -> Iterator[tuple[str, Any]]:
    """Every key of every part, with what it may hold; names below `properties` are keys of the file."""
    if isinstance(below, list):
        for one in below:
            yield from _keys(one)
    elif isinstance(below, dict):
        for name, one in below.items():
            if name in ("properties", "$defs"):
                yield from one.items() if name == "properties" else ()
                for part in one.values():
                    yield from _keys(part)
            else:
                yield from _keys(one)


def _described(below: dict[str, Any], parts: dict[str, Any]) -> bool:
    if "$ref" in below and "description" not in below:
        return _described(parts[below["$ref"].rpartition("/")[2]], parts)
    return bool(below.get("description"))
