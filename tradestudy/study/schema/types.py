"""The types of a study file: the keys that they have, and the members of their unions."""

from __future__ import annotations

import re
from collections.abc import Iterator
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from tradestudy.errors import nearest

_LABEL = re.compile(
    r"(?:function-(?:before|after|wrap|plain)|tuple|list|dict|set|literal|nullable|union|constrained-\w+|lax-or-strict)"
    r"\[.*\]|str|int|float|bool|none|any|constrained-\w+",
    re.DOTALL,
)


def key_names(model: type[BaseModel]) -> list[str]:
    """List the keys that a model knows, as a file spells them."""
    return [field.alias or name for name, field in model.model_fields.items()]


def tags(kind: Any, discriminator: str) -> list[str]:
    """List the values of the key that selects a model in a union."""
    values: list[str] = []
    for member in map(bare, get_args(bare(kind))):
        if get_origin(member) in (Union, UnionType):  # an optional union
            values += tags(member, discriminator)
        elif is_model(member):
            values += map(str, get_args(member.model_fields[discriminator].annotation))
    return values


def keys_of_value(kind: Any) -> list[str]:
    """List the required keys of a value of this type or, if it has none, its optional keys."""
    kind = bare(kind)
    if get_origin(kind) in (Union, UnionType):
        return list(dict.fromkeys(key for member in get_args(kind) for key in keys_of_value(member)))
    if not is_model(kind):
        return []
    required = [field.alias or name for name, field in kind.model_fields.items() if field.is_required()]
    return required or key_names(kind)


def bare(kind: Any) -> Any:
    """Strip annotations from a type."""
    while get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    return kind


def is_model(kind: Any) -> bool:
    """Whether a type is a mapping of a study file."""
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _tags(kind: Any) -> Iterator[str]:
    """List the discriminator values that may select a model in a union."""
    if is_model(kind):
        for field in kind.model_fields.values():
            if get_origin(field.annotation) is Literal:
                yield from (str(text) for text in get_args(field.annotation))


def is_label(step: str | int, kinds: list[Any]) -> bool:
    """Distinguish a union member's label from a key or a position."""
    if not isinstance(step, str):
        return False
    named = any(is_model(kind) and (step == kind.__name__ or step in _tags(kind)) for kind in kinds)
    return named or _LABEL.fullmatch(step) is not None


def chosen(label: str, kinds: list[Any], rest: list[str | int]) -> Any:
    """Find the member of a union that a label names, else one that can contain the next step."""
    for kind in kinds:
        if is_model(kind) and (label in (kind.__name__, *_tags(kind)) or label.endswith(f", {kind.__name__}]")):
            return kind
    wants_position = bool(rest) and isinstance(rest[0], int)
    fitting = [kind for kind in kinds if (get_origin(kind) in (tuple, list)) == wants_position]
    return fitting[0] if fitting else Any


def below(kind: Any, step: str | int) -> Any:
    """Find the type of the value under a key or at a position."""
    if is_model(kind):
        fields = kind.model_fields
        return next((f.annotation for name, f in fields.items() if step in (name, f.alias)), Any)
    arguments = get_args(kind)
    if get_origin(kind) is dict:
        return arguments[1]
    if get_origin(kind) is tuple and isinstance(step, int) and arguments and arguments[-1] is not Ellipsis:
        return arguments[step] if step < len(arguments) else Any
    return arguments[0] if get_origin(kind) in (tuple, list) else Any


def deeper_key(owner: type[BaseModel], name: str) -> str:
    """The path from a model to a much similar key in its parts or their parts, short paths first; empty without one."""
    paths: dict[str, str] = {}
    parts = [("", owner)]
    for _ in range(2):
        parts = [
            (f"{above}{key}.", member)
            for above, part in parts
            for key in key_names(part)
            for member in _models(below(part, key))
        ]
        for above, part in parts:
            paths = {key: f"{above}{key}" for key in key_names(part)} | paths
    return paths.get(nearest(name, paths, cutoff=0.8) or "", "")


def _models(kind: Any) -> list[type[BaseModel]]:
    """The model that a type is, or the members of a union that are models."""
    kind = bare(kind)
    if get_origin(kind) in (Union, UnionType):
        return [model for member in get_args(kind) for model in _models(member)]
    return [kind] if is_model(kind) else []
