"""What diffraction leaves of a blur criterion."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.optics.depth_of_field.limits import as_floats, require

DiffractionMeasure = Literal["none", "airy-diameter", "fwhm"]

# Diameters of the diffraction pattern of a circular pupil in λ N: (2 J₁(x)/x)² with x = π r/(λ N) has its first zero at
# x = 3.8317059702075125 and half its peak at x = 1.6163399483107032; the diameter is 2x/π.
_DIAMETER_IN_WAVELENGTHS_PER_F_NUMBER: Final[dict[DiffractionMeasure, float]] = {
    "none": 0.0,
    "airy-diameter": 2.439339782533009,
    "fwhm": 1.028993969962188,
}


def diffraction_diameter(wavelength: ArrayLike, working_f_number: ArrayLike, measure: DiffractionMeasure) -> FloatArray:
    """Diameter of the diffraction spot on the sensor: 2.44 λ N_w (first dark ring) or 1.03 λ N_w (half maximum).

    Parameters
    ----------
    wavelength
        λ > 0 [m].
    working_f_number
        N_w = b/A [1], distance from the pupil to the sensor over the diameter of the pupil; N (1 + m) for a
        lens focused at magnification m, b_L over the aperture for a microlens.
    measure
        ``airy-diameter``, ``fwhm``, or ``none`` for geometric optics (diameter 0).

    Returns
    -------
    Diameter [m], broadcast.

    Raises
    ------
    OutOfRangeError
        For values that are not positive, or an unknown measure.
    """
    wavelengths, f_numbers = as_floats(wavelength, working_f_number)
    require(wavelengths > 0, "wavelength", wavelengths, limit="> 0 m", remedy="check the unit")
    require(f_numbers > 0, "working f-number", f_numbers, limit="> 0", remedy="give b/A", unit="")
    if measure not in get_args(DiffractionMeasure):
        raise OutOfRangeError(
            "unknown measure of the diffraction spot",
            value=repr(measure),
            limit=" | ".join(get_args(DiffractionMeasure)),
            remedy="name one of these",
        )
    return np.asarray(_DIAMETER_IN_WAVELENGTHS_PER_F_NUMBER[measure] * wavelengths * f_numbers)


@dataclass(frozen=True, kw_only=True)
class BlurAllowance:
    """The geometric blur that a criterion allows beside diffraction."""

    geometric_diameter: FloatArray
    """√(c² − d²) [m]; NaN where diffraction alone exceeds the criterion."""
    exceeded: BoolArray
    """Where diffraction alone exceeds the criterion."""
    reason: str
    """Why there is no allowance somewhere, with the numbers of the worst place; empty if there is everywhere."""


def blur_allowance(blur_criterion: ArrayLike, diffraction_spot: ArrayLike) -> BlurAllowance:
    """Split a criterion in quadrature: geometric blur² + diffraction spot² ≤ c².

    Parameters
    ----------
    blur_criterion
        c > 0 [m], on the sensor.
    diffraction_spot
        Diameter of the diffraction spot ≥ 0 [m], from `diffraction_diameter`.

    Returns
    -------
    The allowance, broadcast. Where diffraction alone equals the criterion the allowance is 0: only the plane
    of focus meets it.

    Raises
    ------
    OutOfRangeError
        For a criterion that is not positive, or a spot that is negative.
    """
    criterion, spot = np.broadcast_arrays(*as_floats(blur_criterion, diffraction_spot))
    require(criterion > 0, "blur criterion", criterion, limit="> 0 m", remedy="declare the blur that counts as sharp")
    require(spot >= 0, "diffraction spot", spot, limit="≥ 0 m", remedy="take it from diffraction_diameter")
    exceeded = np.asarray(spot > criterion)
    remaining = np.sqrt(np.where(exceeded, 0.0, (criterion - spot) * (criterion + spot)))
    reason = ""
    if np.any(exceeded):
        worst = np.unravel_index(np.argmax(np.where(exceeded, spot / criterion, 0.0)), spot.shape)
        reason = (
            f"diffraction alone ({spot[worst] * 1e6:.3g} µm) exceeds the blur criterion"
            f" ({criterion[worst] * 1e6:.3g} µm): nothing is sharp by it; declare a larger blur, open the aperture,"
            " or count the width at half maximum"
        )
    return BlurAllowance(geometric_diameter=np.where(exceeded, np.nan, remaining), exceeded=exceeded, reason=reason)
