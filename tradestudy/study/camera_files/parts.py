"""Plenoptic cameras whose files lack some of their optics: what a file gives, and what the study has to."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Final

import numpy as np

from tradestudy.cameras.imported import Convention, ImportedParts, Stated, Value
from tradestudy.cameras.parts import Layout
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.microlens_coverage import LATTICES
from tradestudy.study.camera_files.located import Located

SAME_PITCH: Final = 1e-3
"""Relative difference between pitches across and down that counts as none."""
_INSTEAD: Final[Mapping[str, tuple[str, ...]]] = {
    "main_lens.focal_length": ("field_of_view",),
    "main_lens.f_number": ("entrance_pupil_diameter",),
    "focus.mla_distance": ("total_covering_plane", "relay"),
}
"""Keys that a study may give instead of one that it is asked for."""


def lattice_rotation(angle: float, layout: Layout) -> float:
    """The rotation [rad] of a lattice, which repeats every 60° or 90°, in the range around 0."""
    period = math.tau / (6 if layout == "hexagonal" else 4)
    return angle - period * round(angle / period)


def nearest_node(point: FloatArray, pitch: float, layout: Layout, rotation: float) -> FloatArray:
    """The vector from the origin of a lattice to its node nearest to a point, in the unit of the pitch."""
    skew, rise = LATTICES[layout].second_vector
    c, s = math.cos(rotation), math.sin(rotation)
    basis = pitch * np.array([[c, -s], [s, c]]) @ np.array([[1.0, skew], [0.0, rise]])
    return np.asarray(basis @ np.rint(np.linalg.solve(basis, point)))


class Parts:
    """Collects the values of a camera under the dotted keys of a study."""

    def __init__(self, top: Located) -> None:
        self.top = top
        self.found: dict[str, Stated] = {}

    def give(self, name: str, value: Value | None, at: Located | None, *, derived: bool = False) -> None:
        """State a value and where it stands in the file; ask the study for it if it is None."""
        self.found[name] = Stated(
            path=tuple(name.split(".")),
            value=value,
            key=(at or self.top).key,
            basis="derived" if derived else "measured",
            instead=_INSTEAD.get(name, ()),
        )

    def length(self, name: str, value: float | None, at: Located | None, *, derived: bool = False) -> None:
        """State a length [m]."""
        self.give(name, None if value is None else f"{float(value)!r} m", at, derived=derived)

    def known(self, values: Mapping[str, float], unit: str, at: Located) -> None:
        """State known values of the calibration, in SI."""
        for name, value in values.items():
            self.give(f"calibration.known.{name}", f"{float(value)!r} {unit}", at)

    def camera(
        self, kind: type[ImportedParts], pixels: tuple[int, int] | None, conventions: Iterable[Convention]
    ) -> ImportedParts:
        """The camera, whose pictures have so many columns and rows; the study is asked for them if they are None."""
        if "sensor.pixels" not in self.found:
            self.give("sensor.pixels", None if pixels is None else [*pixels], None)
        return kind(
            pixels=pixels,
            values=tuple(self.found.values()),
            conventions=tuple(conventions),
            keys={"camera": self.top.key, "pixels": self.found["sensor.pixels"].key},
        )
