"""The focus of a camera: the interface that all kinds of camera share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.parts import require_positive
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field import (
    BlurAllowance,
    DepthOfField,
    DiffractionMeasure,
    IntervalUnion,
    blur_allowance,
    diffraction_diameter,
    union,
)
from tradestudy.optics.lateral_resolution import LateralResolution


@dataclass(frozen=True, kw_only=True)
class BlurCriterion:
    """The largest blur that counts as sharp.

    Parameters
    ----------
    blur_px
        Diameter of the blur in lateral samples: pixels, or microlenses of an unfocused plenoptic camera.
    measure
        Measure of the diffraction spot, added in quadrature to defocus; ``none`` for geometric optics.
    wavelength
        Wavelength λ [m].

    Raises
    ------
    OutOfRangeError
        For a blur or a wavelength that is not positive.
    """

    blur_px: float
    measure: DiffractionMeasure
    wavelength: float

    def __post_init__(self) -> None:
        require_positive("blur that counts as sharp", self.blur_px, "px")
        require_positive("wavelength", self.wavelength)

    def allowance(self, sample_pitch: float, working_f_number: ArrayLike) -> BlurAllowance:
        """The blur that diffraction leaves for defocus [m], ``√(c² − d²)``; see `blur_allowance`."""
        spot = diffraction_diameter(self.wavelength, working_f_number, self.measure)
        return blur_allowance(self.blur_px * sample_pitch, spot)


@dataclass(frozen=True, kw_only=True)
class SharpRange:
    """The sharp range of a camera, in slices and in total.

    Parameters
    ----------
    names
        Names of the slices: an image of a stack, a type of microlens, the lens.
    slices
        Near and far limit [m] of each, shape (slices,); NaN where a slice is sharp nowhere.
    reason
        Why nothing is sharp; empty otherwise.
    """

    names: tuple[str, ...]
    slices: DepthOfField
    reason: str = ""

    @property
    def union(self) -> IntervalUnion:
        """The union of the slices, with gaps and overlaps."""
        return union(self.slices)

    @property
    def extent(self) -> float:
        """Total length of the sharp range [m]; infinite if a far limit is."""
        covered = self.union.covered
        return float(np.sum(covered[:, 1] - covered[:, 0])) if len(covered) else 0.0

    def share_of(self, near: float, far: float) -> float:
        """Share of a range of distances [m], near < far, that is sharp."""
        covered = np.clip(self.union.covered, near, far)
        return float(np.sum(covered[:, 1] - covered[:, 0]) / (far - near))


def sharp_range(names: tuple[str, ...], parts: Sequence[DepthOfField], reason: str = "") -> SharpRange:
    """A sharp range with one slice per name, and with the given reason or those of the parts."""
    near, far = (
        np.concatenate([np.empty(0), *(np.atleast_1d(getattr(part, end)) for part in parts)]) for end in ("near", "far")
    )
    reasons = [reason] if reason else [part.reason for part in parts if part.reason]
    return SharpRange(names=names, slices=DepthOfField(near=near, far=far), reason="; ".join(dict.fromkeys(reasons)))


class Focus(Protocol):
    """The focus of a camera along its optical axis; all distances are measured from the principal plane of its lens."""

    @property
    def mechanisms(self) -> int:
        """Number of lenses that move to cover `sharp_range`."""
        ...

    def sharp_range(self, criterion: BlurCriterion) -> SharpRange:
        """The sharp range for a blur criterion."""
        ...

    def sharp_range_at_resolution(self, resolution: float, wavelength: float) -> SharpRange:
        """The range in which `lateral_resolution` is at most a given size on the object [m]."""
        ...

    def images(self, criterion: BlurCriterion, near: float, far: float) -> int:
        """Number of exposures for a scene from near to far [m]; 0 if no number suffices."""
        ...

    def lateral_resolution(self, distance: ArrayLike, wavelength: float) -> LateralResolution:
        """Sample, geometric blur and Airy radius on the object [m]; NaN where there is no real image."""
        ...

    def diffraction_width(self, distance: ArrayLike, wavelength: float, measure: DiffractionMeasure) -> FloatArray:
        """Width of the diffraction spot, projected to the object [m]; NaN where there is no real image."""
        ...
