"""A conventional camera: one lens, one sensor, and either a fixed focus or a mechanism that takes a stack of images."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from tradestudy.cameras.focus import ImageStackFocus, SingleLensFocus
from tradestudy.cameras.parts import Lens, Sensor, require_positive


@dataclass(frozen=True, kw_only=True)
class FocusStackPlan:
    """How a camera with a focus mechanism takes a stack.

    Parameters
    ----------
    near, far
        Range of distances to cover [m] from the principal plane; far may be infinite.
    most_images
        The most images of one stack.
    time_per_image
        From one image to the next, refocusing included [s]; None where it is not known.

    Raises
    ------
    OutOfRangeError
        For a time that is not positive.
    """

    near: float
    far: float
    most_images: int
    time_per_image: float | None = None

    def __post_init__(self) -> None:
        if self.time_per_image is not None:
            require_positive("time per image", self.time_per_image, "s")


@dataclass(frozen=True, kw_only=True)
class ConventionalCamera:
    """A camera that measures no depth by triangulation; a focus stack makes it one of extended depth of field.

    Parameters
    ----------
    lens, sensor
        The parts.
    focus_distance
        Where a single image is focused [m] from the principal plane; infinity is allowed.
    stack
        How it takes a stack instead of a single image; None for a fixed focus.
    front_to_principal_plane
        How far the principal plane lies behind the front of the lens [m], from which data sheets count working
        distances; None where it is not known.

    Raises
    ------
    OutOfRangeError
        For a focus inside the focal length, or a stack that cannot be.
    """

    lens: Lens
    sensor: Sensor
    focus_distance: float
    stack: FocusStackPlan | None = None
    front_to_principal_plane: float | None = None

    family: Literal["conventional"] = field(default="conventional", init=False)

    def __post_init__(self) -> None:
        # Both check their arguments: a camera that cannot focus so is refused when it is built.
        _ = self.single_image, self.focus

    @property
    def single_image(self) -> SingleLensFocus:
        """The focus of one image at `focus_distance`."""
        return SingleLensFocus(lens=self.lens, focus_distance=self.focus_distance, sample_pitch=self.sensor.pixel_pitch)

    @property
    def focus(self) -> SingleLensFocus | ImageStackFocus:
        """What one image, or the stack where there is one, keeps sharp."""
        if self.stack is None:
            return self.single_image
        return ImageStackFocus(
            lens=self.lens,
            sample_pitch=self.sensor.pixel_pitch,
            near=self.stack.near,
            far=self.stack.far,
            most_images=self.stack.most_images,
        )
