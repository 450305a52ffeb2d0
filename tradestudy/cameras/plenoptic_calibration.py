"""Calibration errors of plenoptic cameras, focused and unfocused."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.depth_camera import ErrorSource
from tradestudy.errors import OutOfRangeError

NO_ERROR = ErrorSource(standard_deviation=0.0)


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
