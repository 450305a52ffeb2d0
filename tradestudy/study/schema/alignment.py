"""The place of a pydantic error in a study file and in the schema.

pydantic locates an error by keys and positions mixed with labels of the union members that it tried. Walking along the
types distinguishes them, and ends at the model that knows which keys are legal.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from tradestudy.study.document import Path

_LABEL = re.compile(
    r"(?:function-(?:before|after|wrap|plain)|tuple|list|dict|set|literal|nullable|union|constrained-\w+|lax-or-strict)"
    r"\[.*\]|str|int|float|bool|none|any|constrained-\w+",
    re.DOTALL,
)
_KEY = "[key]"


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """The place of an error.

    Parameters
    ----------
    path
        Keys and positions in the document.
    members
        For each union along the path, the member that the error is about: the union's path and the member's label.
    owner
        The innermost model along the path, which should contain the last key.
    of_key
        Whether the error is about the last key itself, not about its value.
    kind
        The type of the value at the path.
    """

    path: Path
    members: tuple[tuple[Path, str], ...]
    owner: type[BaseModel] | None
    of_key: bool
    kind: Any


def align(model: type[BaseModel], location: tuple[str | int, ...]) -> Alignment:
    """Follow an error's location through a model."""
    kind: Any = model
    path: Path = ()
    members: list[tuple[Path, str]] = []
    owner: type[BaseModel] | None = None
    rest = list(location)
    while rest:
        kind = _bare(kind)
        if get_origin(kind) in (Union, UnionType):
            members_of_kind = [_bare(member) for member in get_args(kind) if member is not NoneType]
            if len(members_of_kind) > 1 and _is_label(rest[0], members_of_kind):
                label = str(rest.pop(0))
                members.append((path, label))
                kind = _chosen(label, members_of_kind, rest)
            else:
                kind = _chosen("", members_of_kind, rest)
            continue
        step = rest.pop(0)
        if step == _KEY:
            return Alignment(path=path, members=tuple(members), owner=owner, of_key=True, kind=kind)
        path = (*path, step)
        owner = kind if isinstance(kind, type) and issubclass(kind, BaseModel) else None
        kind = _below(kind, step)
    return Alignment(path=path, members=tuple(members), owner=owner, of_key=False, kind=_bare(kind))


def key_names(model: type[BaseModel]) -> list[str]:
    """List the keys that a model knows, as a file spells them."""
    return [field.alias or name for name, field in model.model_fields.items()]


def key_meaning(model: type[BaseModel] | None, key: str) -> str:
    """The first sentence of a key's description, without its full stop."""
    fields = model.model_fields if model else {}
    words = next((field.description or "" for name, field in fields.items() if key in (name, field.alias)), "")
    return words.split(". ")[0].removesuffix(".")


def value_schema(model: type[BaseModel] | None, key: str) -> dict[str, Any]:
    """The JSON Schema of a key's value, without references to other parts; empty if the model has no such key."""
    found: dict[str, Any] = model.model_json_schema().get("properties", {}).get(key, {}) if model else {}
    return found


def tags(kind: Any, discriminator: str) -> list[str]:
    """List the values of the key that selects a model in a union."""
    found: list[str] = []
    for member in map(_bare, get_args(_bare(kind))):
        if get_origin(member) in (Union, UnionType):  # an optional union
            found += tags(member, discriminator)
        elif _is_model(member):
            found += map(str, get_args(member.model_fields[discriminator].annotation))
    return found


def keys_of_value(kind: Any) -> list[str]:
    """List the required keys of a value of this type or, if it has none, its optional keys."""
    kind = _bare(kind)
    if get_origin(kind) in (Union, UnionType):
        return list(dict.fromkeys(key for member in get_args(kind) for key in keys_of_value(member)))
    if not _is_model(kind):
        return []
    required = [field.alias or name for name, field in kind.model_fields.items() if field.is_required()]
    return required or key_names(kind)


def keys_of_part(model: type[BaseModel] | None, key: str) -> list[str]:
    """List the keys of the part under a model's key; none if the value there is not a part."""
    kind = _bare(_below(model, key))
    return keys_of_value(kind) if _is_model(kind) else []


def _bare(kind: Any) -> Any:
    """Strip annotations from a type."""
    while get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    return kind


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _tags(kind: Any) -> Iterator[str]:
    """List the discriminator values that may select a model in a union."""
    if _is_model(kind):
        for field in kind.model_fields.values():
            if get_origin(field.annotation) is Literal:
                yield from (str(text) for text in get_args(field.annotation))


def _is_label(step: str | int, kinds: list[Any]) -> bool:
    """Distinguish a union member's label from a key or a position."""
    if not isinstance(step, str):
        return False
    named = any(_is_model(kind) and (step == kind.__name__ or step in _tags(kind)) for kind in kinds)
    return named or _LABEL.fullmatch(step) is not None


def _chosen(label: str, kinds: list[Any], rest: list[str | int]) -> Any:
    """Find the member of a union that a label names, else one that can contain the next step."""
    for kind in kinds:
        if _is_model(kind) and (label in (kind.__name__, *_tags(kind)) or label.endswith(f", {kind.__name__}]")):
            return kind
    wants_position = bool(rest) and isinstance(rest[0], int)
    fitting = [kind for kind in kinds if (get_origin(kind) in (tuple, list)) == wants_position]
    return fitting[0] if fitting else Any


def _below(kind: Any, step: str | int) -> Any:
    """Find the type of the value under a key or at a position."""
    if _is_model(kind):
        fields = kind.model_fields
        return next((f.annotation for name, f in fields.items() if step in (name, f.alias)), Any)
    arguments = get_args(kind)
    if get_origin(kind) is dict:
        return arguments[1]
    if get_origin(kind) is tuple and isinstance(step, int) and arguments and arguments[-1] is not Ellipsis:
        return arguments[step] if step < len(arguments) else Any
    return arguments[0] if get_origin(kind) in (tuple, list) else Any
