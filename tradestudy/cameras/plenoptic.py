"""What cameras with a microlens array behind their main lens share: calibration errors, fill factor, matching."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.contradictions import PRINTED_TOLERANCE, Contradiction, show
from tradestudy.cameras.depth_camera import NO_ERROR, DepthCamera, DepthErrorPart, ErrorSource
from tradestudy.cameras.parts import Lens, MicrolensArray
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.units import FRACTION, LENGTH, pretty

if TYPE_CHECKING:
    from tradestudy.cameras.stated_declaration import StatedPart
    from tradestudy.uncertainty.sources import Group

# f-number matching is a rule of thumb of lens design; a few percent neither wastes nor mixes pixels.
_MATCHING_TOLERANCE: Final = 0.05
DECLARED_ERRORS: Final = {"mla_distance": "m", "focal_length": "m", "microlens_gap": "m", "pixel_noise": "m"}
"""Errors that a camera declares of itself, with their units; the last is that of the disparity."""
_CELL_OVER_PITCH_SQUARED: Final = {"hexagonal": math.sqrt(3.0) / 2.0, "square": 1.0}


@dataclass(frozen=True, kw_only=True)
class PlenopticCalibration:
    """Calibration errors of the camera, each one draw per camera.

    Parameters
    ----------
    mla_distance, focal_length
        Of z and of f_M [m], both normal.
    correlation
        Between the two, because calibration on targets determines z − f_M far better than either; −1 … 1.
    microlens_gap
        Of b_L [m].

    Raises
    ------
    OutOfRangeError
        For a correlation outside −1 … 1.
    """

    mla_distance: ErrorSource = NO_ERROR
    focal_length: ErrorSource = NO_ERROR
    correlation: float = 0.0
    microlens_gap: ErrorSource = NO_ERROR

    def __post_init__(self) -> None:
        if not -1.0 <= self.correlation <= 1.0:
            raise OutOfRangeError("a correlation", value=f"{self.correlation:g}", limit="−1 to 1")
        for name in ("mla_distance", "focal_length"):
            if getattr(self, name).shape != "normal":
                raise OutOfRangeError(
                    f"the error of {name} is drawn jointly with its partner", value="uniform", limit="normal"
                )

    def error_directions(
        self, disparity_noise: ArrayLike, expanded: float = 0.0
    ) -> Mapping[str, tuple[Mapping[str, ArrayLike], ...]]:
        """Independent one-standard-deviation errors by part; zeros left out.

        z and f are split into what they share and what f has alone. ``disparity_noise`` [m] is that of one disparity,
        ``expanded`` [m] what temperature adds to z.
        """
        sigma_z, sigma_f = self.mla_distance.standard_deviation, self.focal_length.standard_deviation
        alone = math.sqrt(1.0 - self.correlation**2)
        directions: dict[str, tuple[Mapping[str, ArrayLike], ...]] = {
            "pixel_noise": ({"pixel_noise": disparity_noise},),
            "mla_distance_and_focal_length": (
                {"mla_distance": sigma_z, "focal_length": self.correlation * sigma_f},
                {"focal_length": alone * sigma_f},
            ),
            "microlens_gap": ({"microlens_gap": self.microlens_gap.standard_deviation},),
            "temperature": ({"mla_distance": expanded},),
        }
        return {
            name: parts
            for name, parts in directions.items()
            if any(np.any(value) for part in parts for value in part.values())
        }

    def groups(self, noise: float) -> Iterator[Group]:
        """These errors and the noise of disparity [m], as they are drawn under the names of an exact model."""
        from tradestudy.cameras.error_groups import measurement_noise, per_rig
        from tradestudy.uncertainty.error_class import ErrorClass
        from tradestudy.uncertainty.joint import JointNormal

        deviations = np.array([self.mla_distance.standard_deviation, self.focal_length.standard_deviation])
        if self.correlation == 0.0:
            yield from per_rig("mla_distance", self.mla_distance)
            yield from per_rig("focal_length", self.focal_length)
        elif np.any(deviations > 0.0):
            yield JointNormal.from_correlation(
                name="mla_distance_and_focal_length",
                parameters=("mla_distance", "focal_length"),
                mean=np.zeros(2),
                standard_deviation=deviations,
                correlation=np.array([[1.0, self.correlation], [self.correlation, 1.0]]),
                error_class=ErrorClass.RIG,
            )
        yield from per_rig("microlens_gap", self.microlens_gap)
        yield measurement_noise("pixel_noise", noise)


def plenoptic_parts(
    camera: DepthCamera,
    calibration: PlenopticCalibration,
    distance: ArrayLike,
    *,
    of_mla_distance: FloatArray,
    of_focal_length: FloatArray,
    of_gap: FloatArray,
    expanded: float,
) -> tuple[DepthErrorPart, ...]:
    """Parts of the depth error of a camera as errors of disparity [m], to first order.

    Parameters
    ----------
    camera, calibration, distance
        The camera with its errors, and where [m].
    of_mla_distance, of_focal_length, of_gap
        Change of disparity per change of z, of −f_M and of b_L [1]: an error of z acts against one of f_M, and the two
        are one part, with their correlation.
    expanded
        Standard deviation [m] of z with temperature.
    """
    sigma_z, sigma_f = calibration.mla_distance.standard_deviation, calibration.focal_length.standard_deviation
    from_z, from_f = of_mla_distance * sigma_z, of_focal_length * sigma_f
    joint = np.sqrt(np.maximum(from_z**2 - 2.0 * calibration.correlation * from_z * from_f + from_f**2, 0.0))
    drawn = ErrorSource(standard_deviation=1.0) if sigma_z > 0.0 or sigma_f > 0.0 else NO_ERROR
    return camera.parts_of(
        distance,
        {
            "mla_distance_and_focal_length": (drawn, joint),
            "microlens_gap": (calibration.microlens_gap, np.abs(of_gap)),
            "temperature": (ErrorSource(standard_deviation=expanded), np.abs(of_mla_distance)),
        },
    )


def fill_factor(array: MicrolensArray) -> str:
    """Share of the array that passes light, and the diameters behind it."""
    aperture, pitch = array.aperture_diameter, array.pitch
    area = math.pi / 4.0 * aperture**2 / (_CELL_OVER_PITCH_SQUARED[array.layout] * pitch**2)
    return f"{pretty(area, FRACTION)} ({pretty(aperture, LENGTH, 4)} on {pretty(pitch, LENGTH, 4)})"


def array_contradictions(
    lens: Lens, array: MicrolensArray, mla_distance: float, stated: StatedPart | None
) -> list[Contradiction]:
    """Distances as stated, and the f-numbers of microlenses and main lens, held against each other."""
    pairs = (
        ("microlens gap", stated.microlens_gap if stated else None, array.gap),
        ("distance from main lens to array", stated.mla_distance if stated else None, mla_distance),
    )
    found = [
        Contradiction(what=what, stated=show(value, LENGTH), implied=show(used, LENGTH), used="the implied value")
        for what, value, used in pairs
        if value is not None and not math.isclose(value, used, rel_tol=PRINTED_TOLERANCE)
    ]
    micro, main = array.gap / array.pitch, mla_distance / lens.pupil_diameter
    if not math.isclose(micro, main, rel_tol=_MATCHING_TOLERANCE):
        found.append(
            Contradiction(
                what="f-number matching of microlenses and main lens",
                stated=f"main lens f/{main:.3g} on the image side",
                implied=f"microlenses f/{micro:.3g} by pitch and gap",
                used=f"gap {show(array.gap, LENGTH)}; micro-images "
                + ("leave pixels dark" if micro < main else "overlap"),
            )
        )
    return found
