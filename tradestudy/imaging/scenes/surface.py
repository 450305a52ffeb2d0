"""The interface of every surface of a scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from tradestudy.imaging.scenes.pattern import PicturePattern, RandomPattern
from tradestudy.optics.arrays import BoolArray, FloatArray

PatternSource = RandomPattern | PicturePattern


@dataclass(frozen=True, kw_only=True, eq=False)
class Nearby:
    """What following one ray reveals about nearby rays.

    Parameters
    ----------
    safe
        Depth [m] up to which no nearby ray meets the surface, shape (rays,).
    met
        Depth [m] at which the followed ray meets it.
    direct
        Whether both depths are so close that nearby rays also meet the surface there and not earlier.
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
        """Pattern on the surface."""

    @property
    def extent(self) -> tuple[float, float]:
        """Nearest and farthest depth of the surface [m]; of an infinite plane, the depth at which the axis meets it."""

    def approach(self, start: FloatArray, slope: FloatArray, spread: float) -> tuple[FloatArray, Nearby | None]:
        """Depth at which rays first meet the surface [m], infinite if never, and what that reveals about nearby rays.

        Nearby rays pass within ``spread`` [m] of the given ones at every depth. None means that `depth` needs no help.
        """

    def depth(self, start: FloatArray, slope: FloatArray, nearby: Nearby | None) -> FloatArray:
        """Depth at which rays first meet the surface [m], given what is known about them."""

    def place(self, at: FloatArray, depth: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions on the pattern, in its unit, of points given by lateral positions (2, points) and depths."""

    def pattern_scale(self, depth: FloatArray) -> FloatArray | float:
        """Lengths on the pattern relative to lengths across the line of sight."""
