"""The JSON Schema of study files as written, with bases of values, and cameras from files or like other cameras."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from tradestudy.study.document import BASES, OF_SOURCE

_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_LONG = 50  # characters; a reference takes about thirty
_WITH_BASIS = "v0"  # beside the numbered names of values; names in capitals are those of mappings in the file
_SHARING: dict[str, dict[str, Any]] = {
    "from": {
        "type": ["string", "array"],
        "items": {"type": "string"},
        "minItems": 1,
        "description": "File of a camera, or one or more calibration files; paths are relative to the study.",
    },
    "like": {"type": "string", "description": "Name of the camera of this study that this one starts from."},
}
# A value of any kind with its basis; the keys that refer to it limit the value.
_ANY_WITH_BASIS = {
    "type": "object",
    "properties": {
        "value": {},
        "basis": {"enum": list(BASES), "description": "Basis of the value."},
        "note": {"type": "string", "description": "Where the value comes from, in words."},
        "source": {
            "type": "object",
            "description": "Document in which the value was read, the day of reading, and the words that state it.",
            "propertyNames": {"enum": list(OF_SOURCE)},
            "additionalProperties": {"type": "string"},
            "required": [key for key in OF_SOURCE if key != "revision"],
        },
    },
    "required": ["value"],
    "additionalProperties": False,
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
    values: dict[str, str] = {}
    opened = _opened(_described(schema, parts), parts, values)
    opened["$defs"] = {name: _opened(_described(part, parts), parts, values) for name, part in parts.items()}
    opened["$defs"] |= {name: json.loads(text) for text, name in values.items()}
    opened["$defs"][_WITH_BASIS] = _ANY_WITH_BASIS
    cameras = opened["properties"]["cameras"]
    # Let a camera name a file or another camera instead of being written in full.
    starts = [{"type": "object", "properties": {key: written}, "required": [key]} for key, written in _SHARING.items()]
    cameras["patternProperties"] = {
        pattern: {"anyOf": [camera, *starts]} for pattern, camera in cameras["patternProperties"].items()
    }
    uses = Counter(re.findall(r'"#/\$defs/(v\d+)"', json.dumps(opened)))
    single = {name: definition for name, definition in opened["$defs"].items() if uses[name] == 1}
    opened["$defs"] = {name: definition for name, definition in opened["$defs"].items() if name not in single}
    return {"$schema": _DIALECT, **_inlined(opened, single)}


def _inlined(schema: Any, single: Mapping[str, Any]) -> Any:
    """A schema with definitions that are used once where they are used; a description beside a reference stays."""
    if isinstance(schema, list):
        return [_inlined(below, single) for below in schema]
    if not isinstance(schema, dict):
        return schema
    if (definition := single.get(str(schema.get("$ref")).rpartition("/")[2])) is not None:
        return _inlined({**definition, **{key: value for key, value in schema.items() if key != "$ref"}}, single)
    return {key: _inlined(value, single) for key, value in schema.items()}


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

    described = {key: value for key, value in part.items() if key != "title"}  # the name of a class
    if "properties" in part:
        described["properties"] = {
            key: _telling(below) if {*below} == {"$ref"} else {**_telling(below), "description": meaning(below)}
            for key, below in part["properties"].items()
        }
    return described


def _telling(schema: Mapping[str, Any]) -> dict[str, Any]:
    """Drop what does not help an editor: titles that pydantic derives from keys, and defaults that say nothing."""
    is_quantity = "pattern" in schema and "examples" in schema  # whose title states its limits
    return {
        key: value for key, value in schema.items() if (key != "title" or is_quantity) and not _is_empty(key, value)
    }


def _is_empty(key: str, value: Any) -> bool:
    """Whether this is a default of null, or one of a mapping whose keys all are null or empty."""
    return key == "default" and (value is None or (isinstance(value, Mapping) and not any(value.values())))


def _opened(schema: Mapping[str, Any], parts: Mapping[str, Any], values: dict[str, str]) -> dict[str, Any]:
    """Let every value below a schema have a basis; ``values`` collects the names of repeated definitions."""
    opened = {key: value for key, value in schema.items() if key != "discriminator"}  # OpenAPI, which no editor reads
    for place in ("properties", "patternProperties"):
        if place in schema:
            opened[place] = {name: _with_basis(below, parts, values) for name, below in schema[place].items()}
    for place in ("items", "additionalProperties"):
        if isinstance(schema.get(place), Mapping):
            opened[place] = _with_basis(schema[place], parts, values)
    for place in ("prefixItems", "anyOf", "oneOf"):
        if place in schema:
            opened[place] = [_defined(_opened(below, parts, values), values) for below in schema[place]]
    return opened


def _with_basis(schema: Mapping[str, Any], parts: Mapping[str, Any], values: dict[str, str]) -> dict[str, Any]:
    """Let every value below a schema have a basis, and the schema's own if it is a single value or a list."""
    opened = _opened(schema, parts, values)
    is_value = _is_value(schema, parts)
    if not is_value and "anyOf" not in opened:
        return opened
    # Description and default belong to the key; many keys share the rest, such as a part or null.
    shown: dict[str, Any] = {key: opened.pop(key) for key in ("description", "default") if key in opened}
    bare = _defined(opened, values)
    if not is_value:
        return {**shown, **bare}
    # Some editors drop the properties of a part if others stand beside its reference, so that goes into allOf.
    written = {"allOf": [{"$ref": f"#/$defs/{_WITH_BASIS}"}], "properties": {"value": bare}}
    either = {"anyOf": [bare, written]}
    return {**shown, **(either if "const" in bare else _defined(either, values))}


def _defined(schema: dict[str, Any], values: dict[str, str]) -> dict[str, Any]:
    """A reference to a definition of the schema, with a short name because there are many; itself if it is short."""
    text = json.dumps(schema)
    return {"$ref": f"#/$defs/{values.setdefault(text, f'v{len(values) + 1}')}"} if len(text) > _LONG else schema


def _is_value(schema: Mapping[str, Any], parts: Mapping[str, Any]) -> bool:
    """Whether a schema describes a value or a list, not a mapping."""
    if "$ref" in schema:
        return _is_value(parts[schema["$ref"].rpartition("/")[2]], parts)
    alternatives = schema.get("anyOf") or schema.get("oneOf")
    if alternatives:
        return any(_is_value(below, parts) for below in alternatives)
    return schema.get("type") not in ("object", "null")
