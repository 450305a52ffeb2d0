"""What every surface of a scene can be asked."""

from __future__ import annotations

from typing import Protocol

from tradestudy.imaging.scenes.pattern import PicturePattern, RandomPattern
from tradestudy.optics.arrays import FloatArray

PatternSource = RandomPattern | PicturePattern


class Surface(Protocol):
    """A surface in the frame of the scene: x to the right, y down, z into it [m].

    A ray passes ``start + z slope`` at depth z; starts and slopes have shape (2, rays), depths (rays,).
    """

    @property
    def pattern(self) -> PatternSource:
        """What is painted on it."""

    @property
    def extent(self) -> tuple[float, float]:
        """Nearest and farthest depth that it reaches [m]; planes that go on for ever say where the axis meets them."""

    def approach(self, start: FloatArray, slope: FloatArray, spread: float) -> tuple[FloatArray, FloatArray | None]:
        """Where rays meet it first [m], infinite where they do not; and up to where rays nearby do not meet it.

        Rays nearby pass within ``spread`` [m] of the given ones at every depth. None: their own `depth` needs no help.
        """

    def depth(self, start: FloatArray, slope: FloatArray, begin: FloatArray | None) -> FloatArray:
        """Where rays meet it first, given from which depth to look."""

    def place(self, at: FloatArray, depth: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where points of it (lateral places (2, points) and depths) lie on its pattern, in the unit of that."""

    def pattern_scale(self, depth: FloatArray) -> FloatArray | float:
        """Lengths on the pattern over lengths across the line of sight."""
