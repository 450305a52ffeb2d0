"""What every camera has in common, whether it measures depth or not."""

from __future__ import annotations

from typing import Literal, Protocol

from tradestudy.cameras.focus import Focus
from tradestudy.cameras.parts import Sensor

Family = Literal["plenoptic", "stereo", "conventional"]


class Camera(Protocol):
    """A camera: pixels and a focus. Those that measure depth are a `DepthCamera` too."""

    @property
    def family(self) -> Family:
        """Which idea it is."""
        ...

    @property
    def sensor(self) -> Sensor:
        """One of its sensors."""
        ...

    @property
    def focus(self) -> Focus:
        """What it keeps sharp."""
        ...
