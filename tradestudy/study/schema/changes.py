"""Validation of a valid study with other values: only the changed parts are validated again."""

from __future__ import annotations

from contextlib import suppress
from typing import Any

from tradestudy.declarations.part import Part
from tradestudy.study.document import Document, Entry, MappingEntry, child, plain
from tradestudy.study.schema.root import StudyFile
from tradestudy.study.schema.validation import validate


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
            found = valid.with_parts(_changed_parts(document, before, valid))
            if not StudyFile.mistakes_of_names(document.tree):
                return found
    return validate(document, StudyFile)


def _changed_parts(document: Document, before: Document, valid: StudyFile) -> dict[str, Any]:
    """The changed parts of a study; for parts in a mapping by name, the whole mapping."""
    changed: dict[str, Any] = {}
    for key in _changed_keys(document.root, before.root):
        part, entry, entry_before = getattr(valid, key, None), child(document.root, key), child(before.root, key)
        if isinstance(part, dict) and isinstance(entry, MappingEntry) and isinstance(entry_before, MappingEntry):
            names = _changed_keys(entry, entry_before)
            changed[key] = part | {name: _validated(part.get(name), child(entry, name)) for name in names}
        else:
            changed[key] = _validated(part, entry)
    return changed


def _changed_keys(mapping: MappingEntry, before: MappingEntry) -> list[str]:
    if not before.members.keys() <= mapping.members.keys():
        raise _WhollyNewError
    return [key for key, member in mapping.members.items() if member.entry is not child(before, key)]


def _validated(before: object, entry: Entry | None) -> Part:
    if not isinstance(before, Part) or entry is None:
        raise _WhollyNewError
    return type(before).model_validate(plain(entry))
