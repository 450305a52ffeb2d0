"""What every surface of a scene can be asked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from tradestudy.imaging.scenes.pattern import PicturePattern, RandomPattern
from tradestudy.optics.arrays import BoolArray, FloatArray

PatternSource = RandomPattern | PicturePattern


@dataclass(frozen=True, kw_only=True, eq=False)
class Nearby:
    """What is known of rays beside one that has been followed.

    Parameters
    ----------
    safe
        Up to where none of them meets the surface [m], shape (rays,).
    met
        Where the one that was followed meets it.
    direct
        Where both lie so close together that the others meet it there, too, and nowhere before.
    """

    safe: FloatArray
    met: FloatArray
    direct: BoolArray


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

    def approach(self, start: FloatArray, slope: FloatArray, spread: float) -> tuple[FloatArray, Nearby | None]:
        """Where rays meet it first [m], infinite where they do not; and what that says of rays nearby.

        Rays nearby pass within ``spread`` [m] of the given ones at every depth. None: their own `depth` needs no help.
        """

    def depth(self, start: FloatArray, slope: FloatArray, nearby: Nearby | None) -> FloatArray:
        """Where rays meet it first, given what is known of them."""

    def place(self, at: FloatArray, depth: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where points of it (lateral places (2, points) and depths) lie on its pattern, in the unit of that."""

    def pattern_scale(self, depth: FloatArray) -> FloatArray | float:
        """Lengths on the pattern over lengths across the line of sight."""
