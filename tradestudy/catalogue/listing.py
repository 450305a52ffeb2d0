"""The list of cameras that `tradestudy cameras` prints: filters, and a table."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

from tradestudy.catalogue import Listed, listed, wanted
from tradestudy.errors import OutOfRangeError, nearest
from tradestudy.units import ANGLE, LENGTH, Dimension, UnitError, parse, pretty
from tradestudy.wording import listed as in_a_row

_HEAD: Final = ("entry", "mode", "kind", "pixels", "f", "view", "baseline", "nearest", "projector")
Span = tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Filters:
    """What cameras must have to be listed; None lists all.

    Parameters
    ----------
    kind
        Kind of camera.
    distances
        Nearest and farthest distance [m]: the camera measures the nearest by the disparities that it searches, and at
        the farthest its disparity is at least one pixel.
    baseline, field_of_view
        Smallest and largest baseline [m] and horizontal field of view [rad].
    """

    kind: str | None = None
    distances: Span | None = None
    baseline: Span | None = None
    field_of_view: Span | None = None

    def keep(self, camera: Listed) -> bool | None:
        """Whether a camera passes; None if a value that decides it is unknown."""
        checks: list[bool | None] = [self.kind is None or camera.kind == self.kind]
        if self.baseline is not None:
            checks.append(camera.baseline is not None and _within(camera.baseline, self.baseline))
        if self.field_of_view is not None:
            checks.append(_within(camera.field_of_view, self.field_of_view))
        if self.distances is not None:
            near, far = self.distances
            unknown = None if camera.baseline is not None else False  # a camera that measures no depth never passes
            checks.append(unknown if camera.one_pixel is None else far <= camera.one_pixel)
            checks.append(unknown if camera.nearest is None else camera.nearest <= near)
        return False if False in checks else None if None in checks else True


def _within(value: float, span: Span) -> bool:
    # Rounding by conversions of units must not exclude a value that equals an end.
    return span[0] * (1.0 - 1e-9) <= value <= span[1] * (1.0 + 1e-9)


def span_of(text: str | None, option: str, dimension: Dimension) -> Span | None:
    """A range such as "50 mm to 100 mm" in SI units; None without a text.

    Raises
    ------
    OutOfRangeError
        The text is no such range, or goes from large to small.
    """
    if text is None:
        return None
    ends, example = text.split(" to "), "60 deg to 90 deg" if dimension is ANGLE else "0.5 m to 3 m"
    try:
        low, high = (parse(end.strip(), dimension) for end in ends)
    except (UnitError, ValueError):
        raise OutOfRangeError(
            f"{option} takes a range", value=text, remedy=f"write both ends with units, such as '{example}'"
        ) from None
    if not 0.0 <= low <= high:
        raise OutOfRangeError(f"{option} takes a range from small to large, and nothing below 0", value=text)
    return low, high


def filters(kind: str | None, distances: str | None, baseline: str | None, field_of_view: str | None) -> Filters:
    """The filters that texts from the command line mean.

    Raises
    ------
    OutOfRangeError
        A text is no range, or no camera of the catalogue is of this kind.
    """
    kinds = sorted({camera.kind for camera in listed()})
    if kind is not None and kind not in kinds:
        close = nearest(kind, kinds)
        remedy = f"did you mean {close}?" if close else ""
        raise OutOfRangeError(
            "no camera of the catalogue is of this kind", value=kind, limit=", ".join(kinds), remedy=remedy
        )
    return Filters(
        kind=kind,
        distances=span_of(distances, "--range", LENGTH),
        baseline=span_of(baseline, "--baseline", LENGTH),
        field_of_view=span_of(field_of_view, "--field-of-view", ANGLE),
    )


def lines(chosen: Filters) -> Iterator[str]:
    """A table of the cameras that pass the filters; then which ones could not be judged."""
    decided = [(camera, chosen.keep(camera)) for camera in listed()]
    rows = [_HEAD, *(_row(camera) for camera, kept in decided if kept)]
    if len(rows) == 1:
        rows = [("no camera passes these filters",)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        yield "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
    if unknown := list(dict.fromkeys(camera.entry for camera, kept in decided if kept is None)):
        yield f"not listed, because their nearest distance is unknown: {in_a_row(unknown)}"
    if missing := [entry.camera for entry in wanted()]:
        yield f"wanted, because no source was found for some values: {in_a_row(missing)}"


def _row(camera: Listed) -> tuple[str, ...]:
    across, down = camera.pixels
    return (
        camera.entry,
        camera.mode or "-",
        camera.kind,
        f"{across} × {down}",
        f"{camera.focal_length_px:.0f} px",
        pretty(camera.field_of_view, ANGLE, 3),
        _length(camera.baseline),
        _length(camera.nearest),
        camera.projector or "?",
    )


def _length(value: float | None) -> str:
    return "-" if value is None else pretty(value, LENGTH, 3)


def content(chosen: Filters) -> dict[str, Any]:
    """The same as plain data in SI units: cameras that pass, cameras that could not be judged, and wanted ones."""
    decided: Sequence[tuple[Listed, bool | None]] = [(camera, chosen.keep(camera)) for camera in listed()]
    return {
        "cameras": [_plain(camera) for camera, kept in decided if kept],
        "undecided": [_plain(camera) for camera, kept in decided if kept is None],
        "wanted": [asdict(entry) for entry in wanted()],
    }


def _plain(camera: Listed) -> dict[str, Any]:
    return {**asdict(camera), "field_of_view_deg": round(math.degrees(camera.field_of_view), 3)}
