"""Studies that hypothesis invents from the schema's own keys, kinds and choices, with values right and wrong."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import seed as fixed_seed
from hypothesis import strategies as st

from tests.campaigns.mutations import NASTY_VALUES
from tradestudy import api

Tree = Any


def invent(count: int, seed: int, feed: Callable[[bytes], None]) -> None:
    """Feed so many invented studies; nothing is shrunk, because every breach is kept as it is."""
    if count == 0:
        return
    schema = api.schema()
    done = 0

    @fixed_seed(seed)
    @settings(
        max_examples=count,
        deadline=None,
        database=None,
        phases=(Phase.generate,),
        suppress_health_check=list(HealthCheck),
    )
    @given(tree=_of(schema, schema["$defs"], 0), flow=st.booleans())
    def each(tree: Tree, flow: bool) -> None:
        nonlocal done
        done += 1
        text = json.dumps(tree, ensure_ascii=False) if flow else _block(tree, 0)
        feed(text.encode("utf-8", errors="surrogatepass"))

    each()
    assert done > 0.5 * count  # hypothesis may run out of different small examples, never by this much


def _of(schema: dict[str, Any], defs: dict[str, Any], depth: int) -> st.SearchStrategy[Tree]:
    """Values that a part of the schema describes, with wrong ones among them."""
    if "$ref" in schema:
        target = defs[schema["$ref"].rsplit("/", 1)[1]]
        return st.deferred(lambda: _of(target, defs, depth + 1)) if depth < 8 else _SCALARS
    if "allOf" in schema:  # a value with its basis
        written = defs[schema["allOf"][0]["$ref"].rsplit("/", 1)[1]]
        return _mapping({**written, "properties": {**written["properties"], **schema["properties"]}}, defs, depth)
    for union in ("anyOf", "oneOf"):
        if union in schema:
            return st.one_of(*(_of(part, defs, depth + 1) for part in schema[union]), _SCALARS)
    if "const" in schema:
        return st.one_of(st.just(schema["const"]), st.just(schema["const"]), _SCALARS)
    if "enum" in schema:
        return st.one_of(st.sampled_from(schema["enum"]), _SCALARS)
    kind = schema.get("type")
    if kind == "object" and "properties" in schema:
        return _mapping(schema, defs, depth)
    if kind == "object":
        inner = schema.get("additionalProperties")
        values = _of(inner, defs, depth + 1) if isinstance(inner, dict) else _SCALARS
        return st.dictionaries(_NAMES, values, max_size=3)
    if kind == "array":
        items = schema.get("items")
        values = _of(items, defs, depth + 1) if isinstance(items, dict) else _SCALARS
        return st.lists(values, max_size=4)
    if kind == "integer":
        return st.one_of(st.integers(-3, 200), st.integers(), _SCALARS)
    if kind == "number":
        return st.one_of(st.floats(), st.integers(-3, 3), _SCALARS)
    return _SCALARS


def _mapping(schema: dict[str, Any], defs: dict[str, Any], depth: int) -> st.SearchStrategy[Tree]:
    required = set(schema.get("required", ()))
    properties = {key: _of(part, defs, depth + 1) for key, part in schema["properties"].items()}
    whole = st.fixed_dictionaries(
        {key: part for key, part in properties.items() if key in required},
        optional={key: part for key, part in properties.items() if key not in required},
    )
    lacking = st.fixed_dictionaries({}, optional=properties)
    more = st.dictionaries(_NAMES, _SCALARS, max_size=1)
    return st.one_of(whole, whole, whole, lacking, st.tuples(whole, more).map(lambda both: both[0] | both[1]), _SCALARS)


_QUANTITIES = st.builds(
    lambda number, unit: f"{number:g} {unit}",
    st.one_of(st.floats(0.01, 1000.0), st.floats(), st.sampled_from([0.0, -1.0, 1e-9, 1e9])),
    st.sampled_from(["m", "mm", "um", "nm", "px", "deg", "mrad", "%", "", "kg", "inch"]),
)
_NAMES = st.one_of(
    st.sampled_from(["rig", "array", "a.b", "from", "like", "value", "cameras", "../x", ""]), st.text(max_size=6)
)
_SCALARS: st.SearchStrategy[Tree] = st.one_of(
    _QUANTITIES,
    _QUANTITIES,
    st.sampled_from(NASTY_VALUES),
    st.text(max_size=12),
    st.booleans(),
    st.none(),
    st.integers(-2, 100),
    st.floats(allow_nan=False),
)


def _block(tree: Tree, indent: int) -> str:
    """YAML in block style, texts in quotes as JSON writes them."""
    pad = "  " * indent
    if isinstance(tree, dict) and tree:
        return "".join(f"\n{pad}{json.dumps(key)}:{_block(value, indent + 1)}" for key, value in tree.items())
    if isinstance(tree, list) and tree:
        return "".join(f"\n{pad}- {json.dumps(value)}" for value in tree)
    return f" {json.dumps(tree)}"
