"""What can be in error about a stereo rig: the vocabulary of its calibration, and the errors that a study declares."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from tradestudy.cameras.depth_camera import NO_ERROR, ErrorSource
from tradestudy.cameras.stereo.pair import SIDES

if TYPE_CHECKING:
    from tradestudy.uncertainty.sources import Group

STEREO_ERRORS: Final[Mapping[str, str]] = {
    "baseline": "m",
    "baseline_direction_y": "rad",
    "baseline_direction_z": "rad",
    "yaw": "rad",
    "pitch": "rad",
    "roll": "rad",
    **{
        f"{side}_{name}": unit
        for names, unit in (
            (("focal_length",), "m"),
            (("principal_point_x", "principal_point_y"), "m"),
            (("distortion_k1", "distortion_k2"), "1"),
            (("pixel_noise",), "m"),
        )
        for side in SIDES
        for name in names
    },
}
"""Errors of a stereo rig with their units, in the order in which they are drawn.

``yaw``, ``pitch``, ``roll`` turn the right camera against the left; ``baseline_direction_y`` and ``_z`` turn the line
of centres against the left camera. Principal points and pixel noise are in metres on the sensor, pixel noise along the
baseline; k₁ and k₂ refer to slopes (r over the principal distance). ``focal_length`` is the error of the principal
distance, as in any calibration in pixels."""


DECLARED_ERRORS: Final[Mapping[str, str]] = {
    "yaw": "rad",
    "pitch": "rad",
    "roll": "rad",
    "baseline": "m",
    "focal_length": "m",
    "principal_point": "m",
    "pixel_noise": "m",
}
"""Errors that a rig declares of itself, with their units; the last is that of the disparity on the sensor."""


@dataclass(frozen=True, kw_only=True)
class StereoCalibration:
    """Calibration errors of the rig, each one draw per rig: what the rig is, less what its calibration says.

    Parameters
    ----------
    yaw, pitch, roll
        Relative rotation of the two cameras about the vertical, the baseline and the optical axis [rad].
    baseline
        Of the distance of the two centres of projection [m].
    focal_length
        Of the common principal distance [m], which is what a calibration's focal length in pixels is. It moves depth by
        ``δZ/Z = δc/c`` wherever the lenses are focused; the focal length of the glass itself enters no line of sight.
    principal_point
        Difference of the two principal points along the baseline [m on the sensor].
    """

    yaw: ErrorSource = NO_ERROR
    pitch: ErrorSource = NO_ERROR
    roll: ErrorSource = NO_ERROR
    baseline: ErrorSource = NO_ERROR
    focal_length: ErrorSource = NO_ERROR
    principal_point: ErrorSource = NO_ERROR

    def groups(self, noise: float) -> Iterator[Group]:
        """These errors and the noise of disparity [m], as they are drawn under the names of `STEREO_ERRORS`.

        The common focal length moves both sides together; the difference of the principal points moves them apart; the
        noise is shared equally by the two pictures.
        """
        from tradestudy.cameras.error_groups import centred, measurement_noise, per_rig, tied

        for name in ("yaw", "pitch", "roll", "baseline"):
            yield from per_rig(name, getattr(self, name))
        if self.focal_length.standard_deviation > 0.0:
            names = ("left_focal_length", "right_focal_length")
            yield tied("focal_length", names, centred(self.focal_length), 1.0)
        if self.principal_point.standard_deviation > 0.0:
            names = ("left_principal_point_x", "right_principal_point_x")
            yield tied("principal_point", names, centred(self.principal_point, share=0.5), -1.0)
        for side in SIDES:
            yield measurement_noise(f"{side}_pixel_noise", noise / 2.0**0.5)
