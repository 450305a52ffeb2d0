"""The JSON Schema of study files as they are written: values may carry a basis, cameras may share."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from tradestudy.study.document import BASES

_DIALECT = "https://json-schema.org/draft/2020-12/schema"
_SHARING = {"from": "File of the camera, relative to the study.", "like": "Name of the camera that this one is like."}


def editor_schema(model: type[BaseModel]) -> dict[str, Any]:
    """Describe a study file to an editor.

    pydantic describes what the model reads; a file says more, for the reader unwraps ``{value: …, basis: …, note: …}``
    and takes cameras from their files and from each other before the model sees them.

    Parameters
    ----------
    model
        The root of the schema; its ``cameras`` are named by a pattern and may share.

    Returns
    -------
    dict
        A JSON Schema.
    """
    schema = model.model_json_schema()
    parts: dict[str, Any] = schema.get("$defs", {})
    opened = _opened(schema, parts)
    opened["$defs"] = {name: _opened(part, parts) for name, part in parts.items()}
    cameras = opened["properties"]["cameras"]
    cameras["patternProperties"] = {
        pattern: _shareable(camera) for pattern, camera in cameras["patternProperties"].items()
    }
    return {"$schema": _DIALECT, **opened}


def _opened(schema: Mapping[str, Any], parts: Mapping[str, Any]) -> dict[str, Any]:
    """Let every value below a schema carry a basis."""
    opened = dict(schema)
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
    """Let a single value or a list be written with the basis it rests on."""
    if not _is_value(schema, parts):
        return schema
    written = {
        "type": "object",
        "properties": {"value": schema, "basis": {"enum": list(BASES)}, "note": {"type": "string"}},
        "required": ["value"],
        "additionalProperties": False,
    }
    shown: dict[str, Any] = {key: schema[key] for key in ("title", "description", "default") if key in schema}
    return {**shown, "anyOf": [schema, written]}


def _is_value(schema: Mapping[str, Any], parts: Mapping[str, Any]) -> bool:
    """Tell values and lists from mappings."""
    if "$ref" in schema:
        return _is_value(parts[schema["$ref"].rpartition("/")[2]], parts)
    alternatives = schema.get("anyOf") or schema.get("oneOf")
    if alternatives:
        return any(_is_value(below, parts) for below in alternatives)
    return schema.get("type") not in ("object", "null")


def _shareable(camera: Mapping[str, Any]) -> dict[str, Any]:
    """Let a camera share instead of being written in full."""
    shared = [
        {"type": "object", "properties": {key: {"type": "string", "description": meaning}}, "required": [key]}
        for key, meaning in _SHARING.items()
    ]
    return {"anyOf": [dict(camera), *shared]}
