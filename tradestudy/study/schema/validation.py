"""Validation of a document: all mistakes at once, each with its place, what is expected and the nearest name."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path as FilePath
from types import NoneType, UnionType
from typing import Any, TypeGuard, TypeVar, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from tradestudy.declarations.part import MistakeAt, Part, nearest_name
from tradestudy.errors import Problem, StudyError, escaped, nearest
from tradestudy.study.document import (
    OF_PYTHON,
    AskedEntry,
    Document,
    Entry,
    ListEntry,
    MappingEntry,
    Path,
    ScalarEntry,
    child,
    dotted,
    plain,
    text_of,
    walk,
)
from tradestudy.study.schema.root import StudyFile
from tradestudy.study.schema.types import (
    bare,
    below,
    chosen,
    deeper_key,
    is_label,
    is_model,
    key_names,
    keys_of_value,
    tags,
)
from tradestudy.study.source import MOST_MISTAKES
from tradestudy.units import UnitError

_KEY = "[key]"


ModelT = TypeVar("ModelT", bound=BaseModel)

# pydantic's error types for values of the wrong shape, and the shape expected instead.
_SHAPES = {
    "model_type": "a mapping",
    "model_attributes_type": "a mapping",
    "dict_type": "a mapping",
    "tuple_type": "a list",
    "list_type": "a list",
    "string_type": "text",
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "int_parsing": "a whole number",
    "float_type": "a plain number",
    "float_parsing": "a plain number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "bool_parsing": "true or false",
}
_NAME = "a letter, digit or _ followed by letters, digits and _ . + -"
_MOST_KEYS = 4
_SPREAD = "standard_deviation"  # the commonest key of distributions
_LIMITS = {
    "greater_than": ("gt", "more than"),
    "greater_than_equal": ("ge", "at least"),
    "less_than": ("lt", "less than"),
    "less_than_equal": ("le", "at most"),
}


def validate(document: Document, model: type[ModelT]) -> ModelT:
    """Check a document against a model.

    Parameters
    ----------
    document
        As returned by `read`.
    model
        A pydantic model that forbids unknown keys; its validators may raise `MistakeAt`, or any `ValueError` about
        the part that they validate.

    Returns
    -------
    BaseModel
        The validated model.

    Raises
    ------
    StudyError
        With every syntax and content mistake, sorted by place.
    """
    if asked := asked_values(document, model):
        raise StudyError([*document.problems, *asked])
    try:
        valid = model.model_validate(document.tree)
    except ValidationError as error:
        # Errors inside a part that could not be assembled merely follow from that.
        details = [
            detail
            for detail in error.errors(include_url=False)
            if document.broken.isdisjoint(detail["loc"][:length] for length in range(len(detail["loc"]) + 1))
        ]
        findings = [_Finding.of(detail, document, model) for detail in details[:MOST_MISTAKES]]
        problems = _problems(document, model, findings)
        if len(details) > MOST_MISTAKES:
            more = f"and {len(details) - MOST_MISTAKES} more mistakes"
            problems.append(document.root.place.problem((), more))
    else:
        problems = []
    if issubclass(model, Part):
        problems += [document.problem(mistake.tail, mistake.what) for mistake in model.mistakes_of_names(document.tree)]
    if problems or document.problems:
        known = document.problems
        new = [problem for problem in problems if not any(_is_same(problem, reported) for reported in known)]
        raise StudyError(list(dict.fromkeys([*known, *new])))
    return valid


def asked_values(document: Document, model: type[BaseModel]) -> list[Problem]:
    """The values that calibration files do not give and the study has to, each with its meaning and unit."""
    problems = []
    for path, entry in walk(document.root, ()):
        if isinstance(entry, AskedEntry):
            meaning, expected = _meaning(_owner(document, path, model), path[-1])
            instead = f", or else {' and '.join(entry.instead)}" if entry.instead else ""
            what = f"not in {FilePath(entry.place.file).name}{expected or '; a value'}{instead} is expected{meaning}"
            problems.append(entry.place.problem(path, what))
    return problems


def _owner(document: Document, path: Path, model: type[BaseModel]) -> type[BaseModel] | None:
    """The model to which the last key of a path belongs; None if the path leads out of the schema."""
    kind: Any = model
    for depth, step in enumerate(path[:-1], start=1):
        kind = bare(below(kind, step))
        if get_origin(kind) in (Union, UnionType):
            tag = child(document.entry(path[:depth]), "kind")
            kind = chosen(text_of(tag) if tag else "", [*map(bare, get_args(kind))], [])
    return kind if is_model(kind) else None


def units_missing(document: Document, model: type[BaseModel]) -> dict[Path, str]:
    """The SI unit of every number that Python gives without one where a quantity is expected, by its path."""
    try:
        model.model_validate(document.tree)
    except ValidationError as error:
        lacking = filter(_lacks_unit, error.errors(include_url=False))
        findings = (_Finding.of(details, document, model) for details in lacking)
        of_python = [finding for finding in findings if is_of_python(finding.entry)]
        return {finding.path: finding.context["error"].without_unit.unit for finding in of_python}
    return {}


def _lacks_unit(details: Any) -> bool:
    mistake = details.get("ctx", {}).get("error")
    return isinstance(mistake, UnitError) and mistake.without_unit is not None


def is_of_python(entry: Entry | None) -> TypeGuard[ScalarEntry]:
    """Whether an entry is a number that is in no file."""
    return isinstance(entry, ScalarEntry) and type(entry.value) in (int, float) and entry.place.file in OF_PYTHON


def _is_same(problem: Problem, reported: Problem) -> bool:
    """Whether a mistake of validation repeats one of reading: at the same place, in the same value or a part of it.

    Several values may share a place, such as those from one line of a calibration file.
    """
    if (problem.file, problem.line, problem.column) != (reported.file, reported.line, reported.column):
        return False
    (shorter, longer) = sorted((problem.path, reported.path), key=len)
    return not shorter or f"{longer}.".startswith((f"{shorter}.", f"{shorter}["))


@dataclass(frozen=True, kw_only=True)
class _Finding:
    """An error of pydantic, aligned with the study file and with the schema.

    Parameters
    ----------
    kind, context, text
        Type of the error, what it depends on, and pydantic's message.
    path, entry
        Keys and positions in the document, and what is there.
    members
        For each union along the path, the member that the error is about: the union's path and the member's label.
    owner
        The innermost model along the path, which should contain the last key.
    of_key
        Whether the error is about the last key itself, not about its value.
    expected
        The type of the value at the path.
    """

    kind: str
    context: Mapping[str, Any]
    text: str
    path: Path
    entry: Entry | None
    members: tuple[tuple[Path, str], ...]
    owner: type[BaseModel] | None
    of_key: bool
    expected: Any

    @classmethod
    def of(cls, details: Any, document: Document, model: type[BaseModel]) -> _Finding:
        """Follow an error's location through a model.

        pydantic locates it by keys and positions mixed with labels of the union members that it tried. Walking along
        the types distinguishes them, and ends at the model that knows which keys are legal.
        """
        kind: Any = model
        path: Path = ()
        members: list[tuple[Path, str]] = []
        owner: type[BaseModel] | None = None
        rest = list(details["loc"])
        while rest and rest[0] != _KEY:
            kind = bare(kind)
            if get_origin(kind) in (Union, UnionType):
                possible = [bare(member) for member in get_args(kind) if member is not NoneType]
                label = str(rest.pop(0)) if len(possible) > 1 and is_label(rest[0], possible) else ""
                if label:
                    members.append((path, label))
                kind = chosen(label, possible, rest)
                continue
            step = rest.pop(0)
            path = (*path, step)
            owner = kind if is_model(kind) else None
            kind = below(kind, step)
        return cls(
            kind=details["type"],
            context=details.get("ctx") or {},
            text=details["msg"],
            path=path,
            entry=document.entry(path),
            members=tuple(members),
            owner=owner,
            of_key=bool(rest),
            expected=bare(kind),
        )


def _problems(document: Document, model: type[BaseModel], all_findings: list[_Finding]) -> list[Problem]:
    """Turn findings into one problem for each place, from the likeliest member of each union."""
    # pydantic counts only the items of a list that are right: too few may follow from wrong ones.
    kept = [
        finding
        for finding in all_findings
        if not (finding.kind == "too_short" and isinstance(finding.entry, ListEntry))
        or len(finding.entry.items) < finding.context["min_length"]
    ]
    # The first finding at a place decides how it is reported: one of this program's validators, if there is one.
    ordered = sorted(_likeliest(kept), key=lambda finding: ([*map(str, finding.path)], finding.kind != "value_error"))
    problems: list[Problem] = []
    for path, group in groupby(ordered, key=lambda finding: finding.path):
        findings = list(group)
        if (misnamed := _misnamed(document, path)) is not None:
            problems.append(misnamed)
        elif findings[0].kind == "missing":
            problems.append(_missing(document, findings[0]))
        elif findings[0].kind == "value_error" and isinstance(findings[0].context.get("error"), MistakeAt):
            problems += [
                document.problem((*path, *single.tail), single.what)
                for finding in findings
                if isinstance(mistake := finding.context.get("error"), MistakeAt)
                for single in mistake.all
            ]
        elif findings[0].kind == "extra_forbidden":
            problems.append(_unknown_key(document, model, findings[0]))
        else:
            problems.append(_wrong_value(document, path, findings))
    return problems


def _likeliest(findings: list[_Finding]) -> list[_Finding]:
    """Of the members tried in a union, keep those that match the shape of the written value."""
    # Outer unions first: a member that they drop takes its findings in inner unions along.
    unions = sorted({path for finding in findings for path, _ in finding.members}, key=len)
    for union in unions:
        by_label: dict[str, list[_Finding]] = {}
        for finding in findings:
            for path, label in finding.members:
                if path == union:
                    by_label.setdefault(label, []).append(finding)
        misshapen = {
            label for label, tried in by_label.items() if any(f.kind in _SHAPES and f.path == union for f in tried)
        }
        # If every member has another shape, none is likelier than the others, and the message lists what all expect.
        if len(misshapen) < len(by_label):
            dropped = {id(finding) for label in misshapen for finding in by_label[label]}
            findings = [finding for finding in findings if id(finding) not in dropped]
    return findings


def _misnamed(document: Document, path: Path) -> Problem | None:
    """Report a part that only ``--set`` names as a misspelling, if another part has a similar name."""
    entry: Entry | None = document.root
    for depth, step in enumerate(path):
        above, entry = entry, child(entry, step)
        if _is_implied(entry) and isinstance(above, MappingEntry):
            siblings = [name for name, member in above.members.items() if member.entry is not entry]
            if nearest(str(step), siblings):
                here = path[: depth + 1]
                return entry.place.problem(here, f"there is no '{step}'{nearest_name(str(step), siblings)}")
    return None


def _missing(document: Document, finding: _Finding) -> Problem:
    """Report a missing key at the part to which it belongs."""
    path, above = finding.path, finding.path[:-1]
    if isinstance(path[-1], int):
        return document.locate(above).problem(
            above, f"the list is too short; its value number {path[-1] + 1} is missing"
        )
    meaning, expected = _meaning(finding.owner, path[-1])
    what = f"this key is missing{meaning}{expected}{' is expected' if expected else ''}"
    return document.locate(above).problem(path, what)


def _meaning(owner: type[BaseModel] | None, key: str | int) -> tuple[str, str]:
    """The meaning of a key in brackets, and the value that is expected there after a semicolon; empty if unknown."""
    if owner is None:
        return "", ""
    fields = owner.model_fields.items()
    words = next((field.description or "" for name, field in fields if key in (name, field.alias)), "")
    meaning = words.split(". ")[0].removesuffix(".")  # its first sentence
    part = bare(below(owner, key))
    expected = _expected_value(owner.model_json_schema().get("properties", {}).get(key, {})) or _with_keys(
        keys_of_value(part) if is_model(part) else (), "; "
    )
    return f" ({meaning})" if meaning else "", expected


def _expected_value(schema: dict[str, Any]) -> str:
    """The expected value of a missing key, as far as its schema states choices, limits or an example."""
    if "anyOf" in schema:
        expectations = [_expected_value(option).removeprefix("; ") for option in schema["anyOf"]]
        return f"; {' or '.join(filter(None, expectations))}" if any(expectations) else ""
    if schema.get("type") == "array" and "examples" not in schema:
        expectations = [_expected_value(schema.get("items", {})).removeprefix("; ")]
        return f"; a list, each {expectations[0]}" if expectations[0] else ""
    if choices := schema.get("enum", [schema["const"]] if "const" in schema else []):
        return f"; {_choice(choices) if all(isinstance(choice, str) for choice in choices) else choices[0]}"
    if "examples" not in schema:
        return ""
    is_quantity = "pattern" in schema  # its title states its limits
    return f"; {schema['title']}" if is_quantity else f"; a value such as {schema['examples'][0]}"


def _with_keys(keys: Sequence[str], before: str = "") -> str:
    """Name the first few keys of a mapping: "a mapping with keys such as focal_length, f_number"."""
    some = ", ".join([*keys[:_MOST_KEYS], *(["…"] if len(keys) > _MOST_KEYS else [])])
    return f"{before}a mapping with keys such as {some}" if keys else ""


def _unknown_key(document: Document, model: type[BaseModel], finding: _Finding) -> Problem:
    """Report an unknown key, and where the study has the same one, or one like it.

    A path of ``--set`` may start with a camera, so its first key may have meant one.
    """
    path, owner = finding.path, finding.owner
    key, keys = str(path[-1]), key_names(owner) if owner else []
    if owner is model and (same := _path_to(document, key)):
        return document.locate_key(path).problem(path, f"unknown key here; the study has '{dotted(same)}'")
    if owner is model and _is_implied(finding.entry):
        cameras = _cameras(document)
        if cameras and nearest(key, [*keys, *cameras]) is None:
            what = f"neither a key of the study nor one of its cameras: {', '.join(map(repr, cameras))}"
            return document.locate_key(path).problem(path, what)
        keys += cameras
    if owner and nearest(key, keys) is None and (deeper := deeper_key(owner, key)):
        return document.locate_key(path).problem(path, f"unknown key here; nearest: '{deeper}'")
    return document.locate_key(path).problem(path, f"unknown key{nearest_name(key, keys)}")


def _path_to(document: Document, key: str) -> Path:
    """The shortest path to a key of this name below the first level and outside lists; empty without one."""
    deeper = (path for path, _ in walk(document.root, ()) if path[1:] and path[-1] == key != path[0])
    return min((path for path in deeper if all(isinstance(step, str) for step in path)), key=len, default=())


def _is_implied(entry: Entry | None) -> TypeGuard[MappingEntry]:
    """Whether only the path of a ``--set`` created an entry."""
    return isinstance(entry, MappingEntry) and entry.implied


def _cameras(document: Document) -> list[str]:
    """Names of the cameras that the study itself declares."""
    cameras = child(document.root, "cameras")
    if not isinstance(cameras, MappingEntry):
        return []
    return [name for name, member in cameras.members.items() if not _is_implied(member.entry)]


def _wrong_value(document: Document, path: Path, findings: Sequence[_Finding]) -> Problem:
    """Report an invalid value or key."""
    first = findings[0]
    if first.of_key:
        return document.locate_key(path).problem(path, _name_message(first))
    if first.kind in ("union_tag_invalid", "union_tag_not_found"):
        return _discriminator(document, first)
    parts = dict.fromkeys(_message(finding) for finding in findings)
    heads = list(dict.fromkeys(head for head, _, _ in parts))
    expected = list(dict.fromkeys(expectation for _, expectation, _ in parts if expectation))
    near = next((near for _, _, near in parts if near), "")
    sentence = "; ".join([heads[0], *([" or ".join(expected)] if expected else [])])
    if expected and "expected" not in sentence:
        sentence += " is expected"
    return document.problem(path, sentence + near)


def _discriminator(document: Document, finding: _Finding) -> Problem:
    """Report an unknown or missing ``kind``."""
    key = finding.context["discriminator"].strip("'")
    path = (*finding.path, key)
    if finding.kind == "union_tag_not_found":
        if _is_implied(finding.entry) and (cameras := _cameras(document)) and finding.path[:-1] == ("cameras",):
            what = f"no camera is called '{finding.path[-1]}'; {_choice(cameras)} is expected"
            return document.problem(finding.path, what)
        what = f"this key is missing; {_choice(tags(finding.expected, key))} is expected"
        return document.locate(finding.path).problem(path, what)
    possible = re.findall(r"'([^']*)'", finding.context["expected_tags"])
    what = f"'{finding.context['tag']}' is unknown; {_choice(possible)} is expected"
    return document.problem(path, what + _only_nearest(str(finding.context["tag"]), possible))


def _name_message(finding: _Finding) -> str:
    """Message for an invalid key of those that a study chooses freely, such as the name of a camera."""
    if finding.kind == "string_too_long":
        return f"this name is too long; at most {finding.context['max_length']} characters are expected"
    return f"this is not a valid name; {_NAME} is expected"


def _message(finding: _Finding) -> tuple[str, str, str]:
    """Message in three parts: what is wrong, what is expected, and the nearest choice."""
    context, kind, shown = finding.context, finding.kind, _shown(finding.entry)
    if kind == "value_error":
        text = str(context["error"])
        head, _, expected = text.rpartition("; ") if isinstance(context["error"], UnitError) else (text, "", "")
        return head, expected, ""
    if kind in _SHAPES:
        keys = keys_of_value(finding.expected) if _SHAPES[kind] == "a mapping" else []
        scalar = isinstance(finding.entry, ScalarEntry)
        example = f", for example {{{_SPREAD}: {shown.strip(chr(39))}}}," if _SPREAD in keys and scalar else ""
        return f"{shown} is given", (_with_keys(keys) or _SHAPES[kind]) + example, ""
    if kind == "literal_error":
        choices = re.findall(r"'([^']*)'", context["expected"])
        if not choices:
            return f"{shown} is not possible", context["expected"].replace(" or ", ", or "), ""
        return f"{shown} is unknown", _choice(choices), _only_nearest(shown.strip("'"), choices)
    if kind in _LIMITS:
        key, words = _LIMITS[kind]
        limit = context[key]
        return f"{shown} is out of range", f"{words} {limit if isinstance(limit, int) else f'{limit:g}'}", ""
    if kind in ("too_short", "too_long"):
        bound, words = ("min_length", "at least") if kind == "too_short" else ("max_length", "at most")
        entry = finding.entry
        count = len(entry.items if isinstance(entry, ListEntry) else getattr(entry, "members", ()))
        here = "1 value is given" if count == 1 else f"{count} values are given"
        return here, f"{words} {context[bound]} {'is' if context[bound] == 1 else 'are'} expected", ""
    if kind == "string_too_short":
        return "the text is empty", "some text", ""
    if kind == "string_too_long":
        return "the text is too long", f"at most {context['max_length']} characters are expected", ""
    if kind == "string_pattern_mismatch":
        return f"{shown} is not a valid name", _NAME, ""
    return finding.text, "", ""


def _choice(names: Sequence[str]) -> str:
    """List names as choices, such as "'log' or 'linear'"."""
    quoted = [f"'{name}'" for name in names]
    return f"{', '.join(quoted[:-1])} or {quoted[-1]}" if len(quoted) > 1 else quoted[0]


def _only_nearest(name: str, choices: Iterable[str]) -> str:
    """Name the nearest choice where there is one."""
    close = nearest(name, choices)
    return f"; nearest: '{close}'" if close else ""


def _shown(entry: Entry | None) -> str:
    """Quote the written value, shortened to one line."""
    if isinstance(entry, ScalarEntry):
        text = escaped(" ".join(entry.text.split()))
        if not text:
            return "an empty value"
        return f"'{text}'" if len(text) <= 40 else f"'{text[:37]}…'"
    return "a list" if isinstance(entry, ListEntry) else "a mapping"


class _WhollyNewError(Exception):
    """The change is not confined to parts that can be validated on their own."""


def validate_changes(document: Document, before: Document, valid: StudyFile) -> StudyFile:
    """Validate a document in which values were replaced.

    Only the changed parts, and the consistency between parts, are validated. If this fails, or if a part was added,
    removed or changed its kind, the whole document is validated.

    Parameters
    ----------
    document
        The document with the new values.
    before
        The document without them; unchanged entries are the same objects in both.
    valid
        The study file validated from `before`.

    Raises
    ------
    StudyError
        As for `validate`.
    """
    if not document.problems:
        with suppress(_WhollyNewError, ValueError):  # mistakes that validators find are ValueErrors
            changed = valid.with_parts(_changed_parts(document, before, valid))
            if not StudyFile.mistakes_of_names(document.tree):
                return changed
    return validate(document, StudyFile)


def _changed_parts(document: Document, before: Document, valid: StudyFile) -> dict[str, Any]:
    """The changed parts of a study; for parts in a mapping by name, the whole mapping."""
    changed: dict[str, Any] = {}
    for key in _changed_keys(document.root, before.root):
        part, entry, entry_before = getattr(valid, key, None), child(document.root, key), child(before.root, key)
        if isinstance(part, dict) and isinstance(entry, MappingEntry) and isinstance(entry_before, MappingEntry):
            names = _changed_keys(entry, entry_before)
            changed[key] = part | {
                name: _validated(part.get(name), child(entry, name), child(entry_before, name)) for name in names
            }
        else:
            changed[key] = _validated(part, entry, entry_before)
    return changed


def _changed_keys(mapping: MappingEntry, before: MappingEntry) -> list[str]:
    if not before.members.keys() <= mapping.members.keys():
        raise _WhollyNewError
    return [key for key, member in mapping.members.items() if member.entry is not child(before, key)]


def _validated(before: object, entry: Entry | None, entry_before: Entry | None) -> Part:
    if not isinstance(before, Part) or entry is None:
        raise _WhollyNewError
    values = plain(entry)
    if hasattr(before, "title") and isinstance(values, dict):  # a camera's depends on its key and on other cameras
        if child(entry, "title") is not child(entry_before, "title"):
            raise _WhollyNewError
        values = {**values, "title": before.title}
    return type(before).model_validate(values)
