"""Pages on every key of a study file, made from its JSON Schema; examples are taken from studies that run."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from ruamel.yaml import YAML

import tradestudy
from tradestudy import units

Schema = Mapping[str, Any]

_PAGES: Final = {
    "scene": ("The scene", ("scene", "depth_loop")),
    "accuracy": ("Accuracy and effects", ("accuracy", "effects", "propagation")),
    "optics": (
        "Depth of field and wave optics",
        ("depth_of_field", "relief", "fresnel_validity", "light_spot", "point_spread", "hard_cases"),
    ),
}
_OTHER_PAGE: Final = ("questions", "Questions")
_LONGEST_EXAMPLE: Final = 90
_BASIS: Final = {"value", "basis", "note"}
# Keys that no shipped study uses.
_EXAMPLES: Final = {
    "degrees_of_freedom": "9",
    "k1": "-0.02",
    "k2": "0.003",
    "over": "[0.4 m, 3 m]",
    "above": "40 mm",
    "below": "500 g",
    "cameras": "[stereo-50mm, stereo-75mm]",
    "candidates": "[stereo-50mm, stereo-75mm]",
    "column": "yaw_deg",
    "compare": "[[stereo-50mm, raytrix-r5], [stereo-75mm, raytrix-r5]]",
    "correlations": "{mla_distance: {focal_length: 0.9}}",
    "criterion": "two pixels",
    "depth": "map.png",
    "field_of_view": "65.24 deg",
    "file": "calibration.csv",
    "glass_index": "1.52",
    "high": "0.05 deg",
    "low": "0.002 deg",
    "name": "mass",
    "order": "[accuracy, mass]",
    "picture": "photo.png",
    "read_as": "{file: OpenCV FileStorage}",
    "reading": "galilean",
    "readings": "[galilean]",
    "note": "what the data sheet calls the wide head",
    "requirement": "far",
    "says": "1 % from 0.4 to 3 m",
    "tolerance_reason": "printed as one digit",
    "vary": "stereo-75mm.calibration.errors.yaw.standard_deviation",
}
_SPELLED: Final = {"[Kk]annala brandt": "Kannala–Brandt", "Psf": "PSF", r"\b([Ff]) number": r"\1-number"}
_DIMENSIONS: Final = sorted(
    (one for one in vars(units).values() if isinstance(one, units.Dimension)), key=lambda one: -len(one.name)
)


@dataclass(frozen=True, kw_only=True)
class Part:
    """A mapping of a study file: where it first stands, and its schema."""

    name: str
    path: str
    schema: Schema

    @property
    def anchor(self) -> str:
        """The target of links to it."""
        return f"part-{self.name.lower()}"


@dataclass(frozen=True, kw_only=True)
class Reference:
    """The schema of study files, and what writes about it needs to know."""

    schema: Schema
    examples: dict[tuple[str, str], str] = field(default_factory=dict)

    def alternatives(self, schema: Schema, name: str = "") -> Iterator[tuple[str, Schema]]:
        """What may stand at a key: the names of parts (empty for values) and their schemas, without null and basis."""
        if "$ref" in schema:
            target = schema["$ref"].rpartition("/")[2]
            is_part = "properties" in self.schema["$defs"][target] and not target.startswith("value")
            yield from self.alternatives(self.schema["$defs"][target], target if is_part else "")
            return
        inner = [*schema.get("anyOf", ()), *schema.get("oneOf", ())]
        if inner:
            for one in inner:
                yield from self.alternatives(one)
        elif schema.get("type") != "null" and set(schema.get("properties", ())) != _BASIS:
            yield name, schema

    def parts_below(self, schema: Schema, path: str) -> Iterator[tuple[str, str]]:
        """Names and paths of the parts that a key leads to."""
        for name, one in self.alternatives(schema):
            if name:
                yield name, path
            for below in _members(one):
                yield from self.parts_below(below, f"{path}.NAME")
            for below in _items(one):
                yield from self.parts_below(below, f"{path}[]")

    def part(self, name: str, path: str) -> Part:
        """A part by its name."""
        return Part(name=name, path=path, schema=self.schema["$defs"][name])

    def reached(self, name: str, path: str, seen: dict[str, str] | None = None) -> dict[str, str]:
        """A part and all parts below it, each with the path by which it is first reached."""
        seen = {} if seen is None else seen
        if name not in seen:
            seen[name] = path
            for key, below in self.schema["$defs"][name]["properties"].items():
                for inner, where in self.parts_below(below, f"{path}.{key}"):
                    self.reached(inner, where, seen)
        return seen

    def learn(self, owner: str, value: Any, schema: Schema) -> None:
        """Take examples of keys from a value as it is written in a study."""
        found = [(name, one) for name, one in self.alternatives(schema) if _fits(value, one)]
        for name, one in found[:1]:
            if isinstance(value, Mapping):
                members = list(_members(one))
                for key, below in value.items():
                    inside = one.get("properties", {}).get(key)
                    if inside is not None:
                        self._keep(name or owner, key, below)
                        self.learn(name or owner, below, inside)
                    elif members:
                        self.learn(name or owner, below, members[0])
            elif isinstance(value, list):
                for below, inside in zip(value, _items(one), strict=False):
                    self.learn(owner, below, inside)

    def _keep(self, owner: str, key: str, value: Any) -> None:
        text = _flow(value)
        if value is not None and len(text) <= _LONGEST_EXAMPLE:
            self.examples.setdefault((owner, key), text)

    def takes(self, schema: Schema) -> str:
        """What may stand at a key, in words."""
        words = dict.fromkeys(self._takes_one(name, one) for name, one in self.alternatives(schema))
        return " or ".join(words)

    def _takes_one(self, name: str, schema: Schema) -> str:
        if name:
            return f"[{_spoken(name)}](#{self.part(name, '').anchor})"
        if "const" in schema:
            return f"`{_flow(schema['const'])}`"
        if "enum" in schema:
            return " or ".join(f"`{_flow(one)}`" for one in schema["enum"] if one is not None)
        if "title" in schema and "examples" in schema:
            return str(schema["title"])
        if "prefixItems" in schema:
            inner = dict.fromkeys(self.takes(one) for one in schema["prefixItems"])
            return f"a list of {len(schema['prefixItems'])}: {', '.join(inner)}"
        if schema.get("type") == "array":
            return f"a list of: {self.takes(schema['items'])}"
        if members := list(_members(schema)):
            return f"by name: {self.takes(members[0])}"
        if "properties" in schema:
            return f"a mapping with {' and '.join(f'`{key}`' for key in schema['properties'])}"
        if isinstance(schema["type"], list):
            return "a number"
        plain = {"boolean": "`true` or `false`", "integer": "a whole number", "number": "a number", "string": "text"}
        return plain[schema["type"]] + _limits(schema)

    def example(self, owner: str, key: str, schema: Schema) -> str:
        """One value that may stand at a key: from a study, else from its schema; a link where only parts may."""
        if (owner, key) in self.examples:
            return f"`{key}: {self.examples[owner, key]}`"
        if key in _EXAMPLES:
            value = YAML(typ="safe", pure=True).load(_EXAMPLES[key])
            if any(not name and _fits(value, one) for name, one in self.alternatives(schema)):
                return f"`{key}: {_EXAMPLES[key]}`"
        for name, one in self.alternatives(schema):
            text = self._made_part(name) if name else self._made(one)
            if text:
                return f"`{key}: {text}`"
        name = next((name for name, _ in self.parts_below(schema, "")), "")
        if not name:
            raise ValueError(f"no example of {owner}.{key}")
        return f"see [{_spoken(name)}](#{self.part(name, '').anchor})"

    def _made_part(self, name: str) -> str:
        """What shipped studies say of the required keys of a part, or of one key where none is; empty if too long."""
        known = {key: text for (owner, key), text in self.examples.items() if owner == name}
        required = self.schema["$defs"][name].get("required", ())
        if not known or not set(required) <= set(known):
            return ""
        text = ", ".join(f"{key}: {known[key]}" for key in required or list(known)[:1])
        return f"{{{text}}}" if len(text) <= _LONGEST_EXAMPLE else ""

    def _made(self, schema: Schema) -> str:
        if "examples" in schema:
            return _flow(schema["examples"][0])
        if "const" in schema:
            return _flow(schema["const"])
        if "enum" in schema:
            return _flow(next(one for one in schema["enum"] if one is not None))
        if schema.get("type") == "boolean":
            return "true"
        if schema.get("type") == "integer":
            return str(schema.get("minimum", 1))
        if schema.get("type") == "array" and schema.get("maxItems", 1) != 0:
            inner = [
                self._made(one)
                for below in _items(schema)
                for name, one in [next(self.alternatives(below))]
                if not name
            ]
            count = max(schema.get("minItems", 1), 1) if "items" in schema else len(inner)
            return (
                f"[{', '.join((inner * count)[:count] if 'items' in schema else inner)}]"
                if all(inner) and inner
                else ""
            )
        return ""

    def lines(self, part: Part) -> Iterator[str]:
        """Everything about one part."""
        yield f"({part.anchor})="
        yield f"## {_spoken(part.name)}"
        yield ""
        if part.path:
            yield f"`{part.path}`"
            yield ""
        if meaning := part.schema.get("description"):
            yield _prose(meaning)
            yield ""
        yield from self.keys(part.name, part.schema)

    def keys(self, owner: str, schema: Schema) -> Iterator[str]:
        """A definition list of the keys of a mapping."""
        required = schema.get("required", ())
        for key, below in schema["properties"].items():
            meaning, takes = below.get("description") or self._described(below), self.takes(below)
            if not (meaning and takes):
                raise ValueError(f"{owner}.{key} has no text")
            yield f"`{key}`"
            yield f": {_prose(meaning)}"
            yield ""
            default = "*Required.*" if key in required else self._default(below)
            yield f"  *Value:* {takes}. {default} "
            yield f"  *Example:* {self.example(owner, key, below)}"
            yield ""

    def _described(self, schema: Schema) -> str:
        """The description behind the references of a key."""
        while "$ref" in schema:
            schema = self.schema["$defs"][schema["$ref"].rpartition("/")[2]]
            if "description" in schema:
                return str(schema["description"])
        return ""

    def _default(self, schema: Schema) -> str:
        """The default of a key that may be left out; "Optional" where it has none."""
        while "$ref" in schema and "default" not in schema:
            schema = self.schema["$defs"][schema["$ref"].rpartition("/")[2]]
        if "default" not in schema or schema["default"] in (None, {}, [], ""):
            return "*Optional.*"
        if isinstance(schema["default"], Mapping):
            return "*Default:* the defaults of its keys."
        titles = [one["title"] for _, one in self.alternatives(schema) if "title" in one]
        dimension = next((one for one in _DIMENSIONS for title in titles[:1] if title.startswith(one.name)), None)
        value = schema["default"]
        if isinstance(value, float) and dimension is not None:
            return f"*Default:* `{units.pretty(value, dimension)}`."
        return f"*Default:* `{_flow(value)}`."


def _members(schema: Schema) -> Iterator[Schema]:
    yield from schema.get("patternProperties", {}).values()
    if isinstance(schema.get("additionalProperties"), Mapping):
        yield schema["additionalProperties"]


def _items(schema: Schema) -> Iterator[Schema]:
    if "prefixItems" in schema:
        yield from schema["prefixItems"]
    elif isinstance(schema.get("items"), Mapping):
        yield schema["items"]


def _fits(value: Any, schema: Schema) -> bool:
    """Roughly check whether a value fits a schema: enough to choose between alternatives."""
    if isinstance(value, Mapping):
        keys = schema.get("properties", {})
        fixed = {key: one["anyOf"][0].get("const") for key, one in keys.items() if "anyOf" in one}
        is_open = any(True for _ in _members(schema))
        return (bool(keys) or is_open) and all(
            (key in keys or is_open) and fixed.get(key) in (None, below) for key, below in value.items()
        )
    if isinstance(value, list):
        return schema.get("type") == "array"
    if isinstance(value, str) and not re.search(schema.get("pattern", ""), value):
        return False
    return schema.get("type") not in ("array", "object") and schema.get("const", value) == value


def _without_basis(value: Any) -> Any:
    """The plain values of a study, of which each may be written with what it rests on."""
    if isinstance(value, list):
        return [_without_basis(one) for one in value]
    if not isinstance(value, Mapping):
        return value
    if "value" in value and set(value) <= _BASIS:
        return value["value"]
    return {key: _without_basis(one) for key, one in value.items()}


def _limits(schema: Schema) -> str:
    low, high = schema.get("minimum"), schema.get("maximum")
    if low is not None and high is not None:
        return f" from {low} to {high}"
    return f" of {low} or more" if low is not None else ""


def _flow(value: Any) -> str:
    """A value as YAML on one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_flow(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_flow, value))}]"
    if isinstance(value, str):
        is_plain = re.fullmatch(r"[^\s\[\]{},&*!|>'\"%@`#:-][^\[\]{},#:\n]*", value) and value not in (
            "off",
            "on",
            "yes",
            "no",
        )
        return value if is_plain else json.dumps(value, ensure_ascii=False)
    return json.dumps(value)


def _spoken(name: str) -> str:
    """``LengthDistribution`` as "Length distribution"."""
    words = re.findall(r"[A-Z][a-z]*", name.removesuffix("Part").removesuffix("Declaration"))
    text = " ".join([words[0], *(word.lower() for word in words[1:])])
    for pattern, spelled in _SPELLED.items():
        text = re.sub(pattern, spelled, text)
    return text


def _prose(text: str) -> str:
    """A description as Markdown: one paragraph, its angle brackets kept from being tags."""
    return " ".join(text.replace("``", "`").replace("<", "&lt;").split())


def study_pages(root: Path) -> dict[str, str]:
    """The pages on study files by their names, without a suffix.

    Parameters
    ----------
    root
        The checkout, whose studies give the examples.
    """
    schema = tradestudy.schema()
    reference = Reference(schema=schema)
    reader = YAML(typ="safe", pure=True)
    camera = next(_members(schema["properties"]["cameras"]))
    for folder, of in (("studies", schema), ("studies/cameras", camera)):
        for path in sorted((root / folder).glob("*.yaml")):
            reference.learn("", _without_basis(reader.load(path.read_text(encoding="utf-8"))), of)

    titles, owners = _owners(reference)
    written = {name: [f"# {title}", ""] for name, title in titles.items()}
    for part, page in owners:
        written[page] += reference.lines(part)
    index = ["# The study file", "", _INDEX.strip(), "", "```{toctree}", *titles, "```", "", "## Top level", ""]
    return {"index": "\n".join([*index, *reference.keys("", schema)])} | {
        name: "\n".join(lines) for name, lines in written.items()
    }


def _owners(reference: Reference) -> tuple[dict[str, str], list[tuple[Part, str]]]:
    """Titles of the pages, and the page of each part: that of the one key that leads to it, or a shared one."""
    roots: list[tuple[str, str, str]] = []  # page, part, path
    titles: dict[str, str] = {}
    for key, below in reference.schema["properties"].items():
        page = next((name for name, (_, keys) in _PAGES.items() if key in keys), _OTHER_PAGE[0])
        for part, path in reference.parts_below(below, key):
            if key == "cameras":
                page = part.removesuffix("Declaration").lower()
                titles[page] = f"Cameras: {_spoken(part).lower()}"
            roots.append((page, part, path))
    kinds = set(titles)
    titles |= {"camera-parts": "Parts of several kinds of camera"}
    titles |= {name: title for name, (title, _) in _PAGES.items()} | dict([_OTHER_PAGE])
    titles |= {"shared": "Parts used throughout"}
    pages: dict[str, set[str]] = {}
    paths: dict[str, str] = {}
    for page, part, path in roots:
        for name, where in reference.reached(part, path).items():
            pages.setdefault(name, set()).add(page)
            paths.setdefault(name, where)

    def home(found: set[str]) -> str:
        if len(found) == 1:
            return next(iter(found))
        return "camera-parts" if found <= kinds else "shared"

    return titles, [
        (reference.part(name, paths[name] if len(found) == 1 else ""), home(found)) for name, found in pages.items()
    ]


_INDEX = """
A study is one YAML file. These pages list its keys, each with the values it accepts, its default and an example. They
are made from the JSON Schema that `python -m tradestudy schema` prints; editors complete keys with it.

Every value may carry its basis: `{value: 12.5 mm, basis: datasheet, note: where it comes from}`, where `basis` is
`paper`, `datasheet`, `measured`, `assumed` or `derived`. A quantity with a unit must be written with it. `null` removes
a value that a shared camera file declares. For a study of format 1, `check` says key by key what to write instead.
"""
