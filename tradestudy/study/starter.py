"""Commented study files to start from."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from types import MappingProxyType
from typing import Any

from tradestudy.catalogue import PREFIX, Listed, listed
from tradestudy.errors import OutOfRangeError, nearest
from tradestudy.study.schema.root import LONGEST_NAME, NAME_PATTERN
from tradestudy.study.source import comment_after


def starter(
    name: str,
    kind: str = "",
    *,
    calibration_files: Sequence[Path] = (),
    said: Sequence[str] = (),
    asked: Mapping[str, str] = MappingProxyType({}),
) -> str:
    """Return the text of a commented study file to start from.

    Parameters
    ----------
    name
        Name of the study, at most 80 characters: letters, digits and ``_``; after the first character also ``.``,
        ``+`` and ``-``.
    kind
        ``stereo`` or ``plenoptic`` for two cameras of this kind, ``measured`` for a stereo rig with a table of measured
        depth errors (see `before_table`). Default: a plenoptic camera and a stereo rig. It has
        no effect with ``calibration_files``.
    calibration_files
        Calibration files of one camera, which replaces the example cameras.
    said
        With ``calibration_files``: further keys of the imported camera, each as a line ``key: value``. It has no effect
        otherwise.
    asked
        Dotted keys of the imported camera that its files do not give, each with what is expected there; comments name
        them.

    Returns
    -------
    str
        Content of the file.

    Raises
    ------
    OutOfRangeError
        If the name is not of this form, or there is no such kind.
    """
    _require_name(name)
    folder = files("tradestudy.study")
    starters = {"": "starter.yaml"} | {
        file.name.removeprefix("starter_").removesuffix(".yaml"): file.name
        for file in folder.iterdir()
        if file.name.startswith("starter_")
    }
    if kind not in starters:
        limit = ", ".join(sorted(filter(None, starters)))
        raise OutOfRangeError("there is no starter of this kind", value=repr(kind), limit=limit)
    file = "imported_starter.yaml" if calibration_files else starters[kind]
    text = folder.joinpath(file).read_text(encoding="utf-8").replace("NAME", name)
    named = ", ".join(f"'{str(path).replace(chr(39), 2 * chr(39))}'" for path in calibration_files)
    come_from = f"from: [{named}]" if len(calibration_files) > 1 else f"from: {named}"
    lines = [come_from, *said, *(_comments(asked) if asked else ())]
    return text.replace("    FROM", "\n".join(f"    {line}" for line in lines))


def _comments(asked: Mapping[str, str]) -> Iterator[str]:
    """Comments that say what the files of a camera do not give, and lines to fill in."""
    yield "# The file does not give these values:"
    yield from (f"#   {key}: {what}" for key, what in asked.items())
    yield "# Fill them in below and remove the # in front, or give them to a command, as in --set rig.KEY=VALUE:"
    yield from (f"# {line}" for line in yaml_lines([f"{key}=…" for key in asked]))


def of_catalogue(name: str, cameras: Sequence[str]) -> str:
    """Return the text of a commented study that compares two cameras of the catalogue.

    Parameters
    ----------
    name
        Name of the study, as for `starter`.
    cameras
        Two entries, each as ``ENTRY`` or ``ENTRY:MODE``.

    Returns
    -------
    str
        Content of the file; its distances are where `between` puts them.

    Raises
    ------
    OutOfRangeError
        If the name is not of this form, there are not two cameras, one is not in the catalogue or has no such mode, or
        it measures no depth.
    """
    _require_name(name)
    rows = [_of_entry(camera) for camera in cameras]
    if len(rows) != 2 or rows[0] == rows[1]:
        named = ", ".join(cameras)
        remedy = "give two that differ, such as two modes" if len(rows) == 2 else "give --camera twice"
        raise OutOfRangeError("new compares two cameras of the catalogue", value=named, remedy=remedy)
    keys = [row.entry for row in rows]
    # Two modes of one entry need different keys.
    keys = [f"{key}-{row.mode}" for key, row in zip(keys, rows, strict=True)] if keys[0] == keys[1] else keys
    lines = [
        f"  {key}: {{from: catalogue/{row.entry}{f', mode: {row.mode}' if row.mode else ''}}}"
        for key, row in zip(keys, rows, strict=True)
    ]
    text = files("tradestudy.study").joinpath("catalogue_starter.yaml").read_text(encoding="utf-8")
    text = text.replace("  CAMERAS", "\n".join(lines)).replace("FIRST", keys[0]).replace("SECOND", keys[1])
    return text.replace("TITLES", " or ".join(row.title for row in rows)).replace("NAME", name)


def _of_entry(text: str) -> Listed:
    """The row of the catalogue that a text such as ``ENTRY:MODE`` names."""
    entry, _, mode = text.removeprefix(PREFIX).partition(":")
    rows = [row for row in listed() if row.entry == entry]
    if not rows:
        close = nearest(entry, [row.entry for row in listed()])
        remedy = f"did you mean {close}? " if close else ""
        raise OutOfRangeError("the catalogue has no such camera", value=entry, remedy=f"{remedy}`cameras` lists them")
    chosen = next((row for row in rows if not mode or row.mode == mode), None)
    if chosen is None:
        limit = ", ".join(row.mode for row in rows if row.mode) or "no modes"
        raise OutOfRangeError(f"{entry} has no such mode", value=mode, limit=limit)
    if chosen.baseline is None:
        raise OutOfRangeError("this camera measures no depth", value=entry, remedy="choose one with a baseline")
    return chosen


def _require_name(name: str) -> None:
    """Refuse what cannot be the name of a study."""
    if not re.fullmatch(NAME_PATTERN, name) or len(name) > LONGEST_NAME:
        raise OutOfRangeError(
            "this cannot be the name of a study",
            value=repr(name),
            limit=f"a letter, digit or underscore, then also . + -, at most {LONGEST_NAME} characters",
            remedy="choose another",
        )


def between(text: str, near: float = 0.5, far: float = 5.0) -> str:
    """The text of an imported camera's study or of its `questions`, for distances from ``near`` to ``far`` [m].

    The default holds until it is known where the camera is usable.
    """
    distances = {"START": near / 2.0, "NEAR": near, "LOW": 1.1 * near, "TWICE": 2.0 * near, "FAR": far}
    for word, distance in distances.items():
        text = text.replace(f"{word} m", f"{float(f'{distance:.2g}'):g} m")
    return text


def before_table(text: str, table: Path) -> str:
    """The text of the starter ``measured`` for a table of measured depth errors, over the distances of that table.

    Raises
    ------
    OutOfRangeError
        The table cannot be read.
    """
    from tradestudy.calibration.measured_table import read_measurements

    distance = read_measurements(table).distance
    named = "'" + str(table).replace("'", "''") + "'"
    return between(text, 0.9 * float(distance.min()), 1.1 * float(distance.max())).replace("TABLE", named)


def with_sharp_views(text: str) -> str:
    """The text of an unfocused plenoptic camera's study, usable where its views are sharp to one microlens.

    These are the distances that it can refocus.
    """
    return text.replace("usable_range: {", "usable_range: {blur: 1 px, ", 1)


def questions() -> str:
    """The requirement and the inverse question with which the study of an imported camera that measures depth ends."""
    return files("tradestudy.study").joinpath("imported_questions.yaml").read_text(encoding="utf-8")


def yaml_lines(said: Sequence[str]) -> list[str]:
    """Texts such as ``a.b=value`` and ``a.c=value`` as YAML with one line for each outer key: ``a: {b: …, c: …}``."""
    keys: dict[str, Any] = {}
    for text in said:
        path, sign, value = text.partition("=")
        if not sign or not path.strip():
            remedy = "write, for example, length_unit=mm"
            raise OutOfRangeError("this is not of the form key=value", value=text, remedy=remedy)
        inside: Any = keys
        *outer, last = path.strip().split(".")
        for key in outer:
            inside = inside.setdefault(key, {}) if isinstance(inside, dict) else inside
        if not isinstance(inside, dict) or last in inside:
            raise OutOfRangeError("--set gives this key, or a part of it, twice", value=path.strip(), remedy="omit one")
        if comment := comment_after(value):
            remedy = "quote the whole value if '#' is part of it"
            raise OutOfRangeError("this part of a value is a YAML comment", value=repr(comment), remedy=remedy)
        inside[last] = value.strip()
    return [_flow(key, value) for key, value in keys.items()]


def _flow(key: str, value: Any) -> str:
    """A key and its value as YAML of one line."""
    text = value if isinstance(value, str) else f"{{{', '.join(_flow(*item) for item in value.items())}}}"
    return f"{key}: {text}"
