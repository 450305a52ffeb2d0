"""The page on the catalogue of cameras, made from its entries and from the list of wanted cameras."""

from __future__ import annotations

import math
from collections.abc import Iterator

from tradestudy.catalogue import PREFIX, Listed, entry_names, listed, wanted
from tradestudy.study.catalogue_entries import Entry, entry_of
from tradestudy.units import LENGTH, PIXELS, pretty

_ABOUT = """
Cameras inside the package. `python -m tradestudy cameras` lists them, `from: catalogue/NAME` in a study uses one
([Choose between two cameras](/how-to/choose-a-camera.md)), and `mode:` beside it chooses one of its modes; without that
key, the first mode holds. [Add a camera](/how-to/add-a-camera.md) tells how to add yours.

A value that a data sheet, a paper or a measurement states has its source, with the words that were read. Every other
value is *derived* from such values or *assumed*, with the reason. Focal lengths hold for the model; your own camera
differs by some per cent, and its calibration file gives its own. No entry declares the errors of a calibration, which
makers do not state: add them under `calibration`.

The *nearest distance* is the product of focal length and baseline divided by the largest disparity that the camera
searches. A *claim* is an accuracy that a maker states. The disparity error that it means would cause the stated
accuracy by matching noise alone. Where the disparity error of the entry was derived from the claim, the claim checks
nothing.
"""


def catalogue_page() -> str:
    """Every entry with its modes, values, sources, contradictions and claims; then the cameras that are wanted."""
    lines = ["# Catalogue of cameras", "", *_ABOUT.strip().splitlines(), ""]
    for name in entry_names():
        lines += [*_entry(name, entry_of(PREFIX + name)), ""]
    lines += ["## Wanted", "", "For these cameras, no source was found for values that a study needs.", ""]
    lines += ["| camera | missing | found |", "|---|---|---|"]
    lines += [f"| {one.camera} | {one.missing} | {one.found} |" for one in wanted()]
    return "\n".join(lines) + "\n"


def _entry(name: str, entry: Entry) -> Iterator[str]:
    rows = [one for one in listed() if one.entry == name]
    note = next(iter(entry.definition.file.cameras.values())).note or ""
    yield from (f"## {name}", "", note, "", f"Revision `{rows[0].revision}`, kind {rows[0].kind}.", "")
    yield "| mode | pixels | focal length | field of view | baseline | nearest distance |"
    yield "|---|---|---|---|---|---|"
    yield from map(_mode, rows)
    yield ""
    yield from ("| value | basis | source or reason |", "|---|---|---|")
    yield from _values(entry)
    yield ""
    for mode, one in entry.contradictions():
        yield f"- Contradiction{_in(mode)}: {one.what}: {one.stated}, but {one.implied}."
    for claim in entry.claims():
        means = pretty(claim.implied_px, PIXELS, 2)
        yield f"- Claim{_in(claim.mode)}: “{claim.part.says}” means a disparity error of {means}; {claim.verdict}."


def _in(mode: str) -> str:
    return f" in mode {mode}" if mode else ""


def _mode(one: Listed) -> str:
    cells = (
        one.mode or "only one",
        f"{one.pixels[0]} × {one.pixels[1]}",
        pretty(one.focal_length_px, PIXELS, 4),
        f"{math.degrees(one.field_of_view):.3g}°",
        "none" if one.baseline is None else pretty(one.baseline, LENGTH, 3),
        "unknown" if one.nearest is None else pretty(one.nearest, LENGTH, 3),
    )
    return f"| {' | '.join(cells)} |"


def _values(entry: Entry) -> Iterator[str]:
    """Each value once, with the modes that have it where they differ."""
    document, modes = entry.definition.document, dict(zip(entry.definition.file.cameras, entry.modes, strict=True))
    found: dict[tuple[str, str], list[str]] = {}
    for path, said in document.annotations.items():
        place = f"`{'.'.join(map(str, path[2:]))}` {document.text_of(path)}"
        remark = said.note
        if said.source is not None:
            named = ", ".join(filter(None, (said.source.title, said.source.revision)))
            link = f"[{named}]({said.source.url})" if said.source.url.startswith("http") else named
            remark = "; ".join(filter(None, (f"{link}: “{said.source.quote}”, read {said.source.read_on}", said.note)))
        cell = f"| {said.basis} | {remark.replace('|', chr(92) + '|')} |"
        found.setdefault((place, cell), []).append(modes[str(path[1])])
    for (place, cell), of in found.items():
        yield f"| {place}{'' if len(of) == len(modes) else f' ({chr(44).join(of)})'} {cell}"
