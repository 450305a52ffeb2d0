"""Remove repetition from JSON Schemas: repeated parts become definitions."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from typing import Any, Final

from pydantic import BaseModel

from tradestudy.study.document import BASES

_WORDS: Final = ("description", "default")
_WORTH_SHARING: Final = 50  # characters; a reference takes about thirty


def shared(schema: Mapping[str, Any]) -> dict[str, Any]:
    """The same JSON Schema, with schemas that occur several times moved to ``$defs`` and referenced there.

    Parameters
    ----------
    schema
        A schema whose ``anyOf`` contain the alternatives; ``$defs`` may contain parts already.

    Returns
    -------
    dict
        An equivalent schema.
    """
    counts: Counter[str] = Counter()
    _count(schema, counts)
    names: dict[str, str] = {}
    found: dict[str, Any] = {}

    def rewritten(below: Any, *, is_whole: bool) -> Any:
        if isinstance(below, list):
            return [rewritten(one, is_whole=False) for one in below]
        if not isinstance(below, Mapping):
            return below
        text = json.dumps(below, sort_keys=True)
        if not is_whole and _is_shared(below, counts[text], text):
            if text not in names:
                names[text] = f"v{len(names) + 1}"  # short, because there are many references
                found[names[text]] = {key: rewritten(one, is_whole=True) for key, one in below.items()}
            return {"$ref": f"#/$defs/{names[text]}"}
        alternatives = _without_words(below)
        if "anyOf" in below and len(alternatives) < len(below) and not is_whole:
            return {**rewritten(alternatives, is_whole=False), **{key: below[key] for key in below if key in _WORDS}}
        # The names under these keys are those of the file, not of the schema language.
        return {
            key: {name: rewritten(part, is_whole=key == "$defs") for name, part in one.items()}
            if key in ("properties", "patternProperties", "$defs")
            else rewritten(one, is_whole=False)
            for key, one in below.items()
        }

    result: dict[str, Any] = rewritten(schema, is_whole=True)
    return {**result, "$defs": {**result.get("$defs", {}), **found}}


def _count(below: Any, counts: Counter[str]) -> None:
    if isinstance(below, Mapping):
        counts[json.dumps(below, sort_keys=True)] += 1
        if "anyOf" in below and len(alternatives := _without_words(below)) < len(below):
            counts[json.dumps(alternatives, sort_keys=True)] += 1
    for one in below.values() if isinstance(below, Mapping) else below if isinstance(below, list) else ():
        _count(one, counts)


def _without_words(below: Mapping[str, Any]) -> dict[str, Any]:
    """A schema without what belongs to the key that has it, so that keys can share the rest."""
    return {key: of for key, of in below.items() if key not in _WORDS}


def _is_shared(below: Mapping[str, Any], count: int, text: str) -> bool:
    is_schema = any(key in below for key in ("type", "anyOf", "oneOf", "enum")) or {"$ref", "description"} <= {*below}
    return is_schema and count > 1 and len(text) > _WORTH_SHARING


_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_WITH_BASIS = "withBasis"  # names in capitals are those of mappings in the file
_SHARING: dict[str, dict[str, Any]] = {
    "from": {
        "type": ["string", "array"],
        "items": {"type": "string"},
        "minItems": 1,
        "description": "File of a camera, or one or more calibration files; paths are relative to the study.",
    },
    "like": {"type": "string", "description": "Name of the camera of this study that this one starts from."},
}


def editor_schema(model: type[BaseModel]) -> dict[str, Any]:
    """Describe a study file to an editor.

    pydantic describes what the model validates. A file may contain more: before validation, the reader unwraps
    ``{value: …, basis: …, note: …}`` and resolves cameras that refer to files or to each other.

    Parameters
    ----------
    model
        The root of the schema; the names of its ``cameras`` follow a pattern.

    Returns
    -------
    dict
        A JSON Schema.
    """
    schema = model.model_json_schema()
    parts: dict[str, Any] = schema.get("$defs", {})
    opened = _opened(_described(schema, parts), parts)
    opened["$defs"] = {name: _opened(_described(part, parts), parts) for name, part in parts.items()}
    opened["$defs"][_WITH_BASIS] = _any_with_basis()
    cameras = opened["properties"]["cameras"]
    cameras["patternProperties"] = {
        pattern: _shareable(camera) for pattern, camera in cameras["patternProperties"].items()
    }
    return {"$schema": _DIALECT, **shared(opened)}


def _described(part: Mapping[str, Any], parts: Mapping[str, Any]) -> dict[str, Any]:
    """Give every key of a part a description; a key without its own takes that of the part it contains or selects.

    A key that only refers to a part needs no copy, since editors follow the reference.
    """

    def meaning(schema: Mapping[str, Any]) -> str:
        if "description" in schema:
            return str(schema["description"])
        if "$ref" in schema:
            return meaning(parts[schema["$ref"].rpartition("/")[2]])
        possible = [below for below in schema.get("anyOf", ()) if below.get("type") != "null"]
        return meaning(possible[0] if len(possible) == 1 else part)

    described = {name: of for name, of in part.items() if name != "title"}  # the name of a class
    if "properties" in part:
        described["properties"] = {
            key: _telling(below) if {*below} == {"$ref"} else {**_telling(below), "description": meaning(below)}
            for key, below in part["properties"].items()
        }
    return described


def _telling(schema: Mapping[str, Any]) -> dict[str, Any]:
    """Drop what does not help an editor: titles that pydantic derives from keys, and null defaults."""
    is_quantity = "pattern" in schema and "examples" in schema  # whose title states its limits
    return {
        name: of for name, of in schema.items() if (name != "title" or is_quantity) and (name, of) != ("default", None)
    }


def _opened(schema: Mapping[str, Any], parts: Mapping[str, Any]) -> dict[str, Any]:
    """Let every value below a schema have a basis."""
    opened = {name: of for name, of in schema.items() if name != "discriminator"}  # OpenAPI, which no editor reads
    for place in ("properties", "patternProperties"):
        if place in schema:
            opened[place] = {name: _with_basis(_opened(below, parts), parts) for name, below in schema[place].items()}
    for place in ("items", "additionalProperties"):
        if isinstance(schema.get(place), Mapping):
            opened[place] = _with_basis(_opened(schema[place], parts), parts)
    for place in ("prefixItems", "anyOf", "oneOf"):
        if place in schema:
            opened[place] = [_opened(below, parts) for below in schema[place]]
    return opened


def _with_basis(schema: dict[str, Any], parts: Mapping[str, Any]) -> dict[str, Any]:
    """Let a single value or a list be written with its basis."""
    if not _is_value(schema, parts):
        return schema
    # Description and default belong to the key; many keys share the rest.
    shown: dict[str, Any] = {key: schema[key] for key in ("description", "default") if key in schema}
    bare = {key: of for key, of in schema.items() if key not in shown}
    # Some editors drop the properties of a part if others stand beside its reference, so that goes into allOf.
    written = {"allOf": [{"$ref": f"#/$defs/{_WITH_BASIS}"}], "properties": {"value": bare}}
    return {**shown, "anyOf": [bare, written]}


def _any_with_basis() -> dict[str, Any]:
    """A value of any kind with its basis; the keys that refer to it limit the value."""
    return {
        "type": "object",
        "properties": {
            "value": {},
            "basis": {"enum": list(BASES), "description": "Basis of the value."},
            "note": {"type": "string", "description": "Where the value comes from, in words."},
        },
        "required": ["value"],
        "additionalProperties": False,
    }


def _is_value(schema: Mapping[str, Any], parts: Mapping[str, Any]) -> bool:
    """Whether a schema describes a value or a list, not a mapping."""
    if "$ref" in schema:
        return _is_value(parts[schema["$ref"].rpartition("/")[2]], parts)
    alternatives = schema.get("anyOf") or schema.get("oneOf")
    if alternatives:
        return any(_is_value(below, parts) for below in alternatives)
    return schema.get("type") not in ("object", "null")


def _shareable(camera: Mapping[str, Any]) -> dict[str, Any]:
    """Let a camera name a file or another camera instead of being written in full."""
    shared = [{"type": "object", "properties": {key: written}, "required": [key]} for key, written in _SHARING.items()]
    return {"anyOf": [dict(camera), *shared]}
