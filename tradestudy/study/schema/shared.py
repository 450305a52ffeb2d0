"""Remove repetition from JSON Schemas: repeated parts become definitions."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Mapping
from typing import Any, Final

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
