"""Depth of field, resolution and number of images of lenses: what all kinds share, one lens, and refocused lenses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.parts import Lens, require_positive
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import FloatArray
from tradestudy.optics.depth_of_field import (
    BlurAllowance,
    DepthOfField,
    DiffractionMeasure,
    IntervalUnion,
    blur_allowance,
    depth_of_field,
    diffraction_diameter,
    images_needed,
    union,
)
from tradestudy.optics.lateral_resolution import (
    LateralResolution,
    airy_radius,
    depth_of_field_at_resolution,
    lateral_resolution,
)
from tradestudy.optics.thin_lens import image_distance


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


def require_focus(focus_distance: float, focal_length: float) -> None:
    """Refuse a focus within the focal length."""
    if not focus_distance > focal_length:
        raise OutOfRangeError(
            "the lens cannot focus that close",
            value=f"{focus_distance * 1e3:g} mm",
            limit=f"beyond the focal length, {focal_length * 1e3:g} mm",
            remedy="increase the focus distance",
        )


@dataclass(frozen=True, kw_only=True)
class SingleLensFocus:
    """A lens with fixed focus.

    Parameters
    ----------
    lens
        The lens.
    focus_distance
        Focus distance a₀ [m] from its principal plane; infinity is allowed.
    sample_pitch
        The pixel pitch [m].
    name
        Name of its only slice.

    Raises
    ------
    OutOfRangeError
        For a focus inside the focal length or a pitch that is not positive.
    """

    lens: Lens
    focus_distance: float
    sample_pitch: float
    name: str = "one image"

    mechanisms = 0

    def __post_init__(self) -> None:
        require_positive("pixel pitch", self.sample_pitch)
        require_focus(self.focus_distance, self.lens.focal_length)

    @property
    def working_f_number(self) -> float:
        """Working f-number N_w = b₀/A."""
        return float(image_distance(self.focus_distance, self.lens.focal_length)) / self.lens.pupil_diameter

    def sharp_range(self, criterion: BlurCriterion) -> SharpRange:
        """The depth of field of the exact thin lens, for the blur that diffraction leaves; see `depth_of_field`."""
        allowance = criterion.allowance(self.sample_pitch, self.working_f_number)
        limits = depth_of_field(
            self.focus_distance, self.lens.focal_length, self.lens.pupil_diameter, allowance.geometric_diameter
        )
        return sharp_range((self.name,), [limits], allowance.reason)

    def sharp_range_at_resolution(self, resolution: float, wavelength: float) -> SharpRange:
        """From ``a₀ (1 − r/A)`` to the nearest of ``a₀ (1 + r/A)``, ``r b₀/p`` and ``r A/(1.22 λ)``.

        See `depth_of_field_at_resolution`.
        """
        limits = depth_of_field_at_resolution(
            resolution,
            focus_distance=self.focus_distance,
            focal_length=self.lens.focal_length,
            pupil_diameter=self.lens.pupil_diameter,
            sample_pitch=self.sample_pitch,
            wavelength=wavelength,
        )
        return sharp_range((self.name,), [limits])

    def images(self, criterion: BlurCriterion, near: float, far: float) -> int:  # noqa: ARG002 - one, whatever the scene
        """Always one."""
        return 1

    def lateral_resolution(self, distance: ArrayLike, wavelength: float) -> LateralResolution:
        """``p a/b₀``, ``A |a − a₀|/a₀`` and ``1.22 λ a/A`` [m]; see `lateral_resolution`."""
        return lateral_resolution(
            distance,
            focus_distance=self.focus_distance,
            focal_length=self.lens.focal_length,
            pupil_diameter=self.lens.pupil_diameter,
            sample_pitch=self.sample_pitch,
            wavelength=wavelength,
        )

    def diffraction_width(self, distance: ArrayLike, wavelength: float, measure: DiffractionMeasure) -> FloatArray:
        """Width of the diffraction spot on the sensor, times a/b₀ [m]."""
        b0 = float(image_distance(self.focus_distance, self.lens.focal_length))
        spot = diffraction_diameter(wavelength, self.working_f_number, measure)
        return np.asarray(spot * (np.asarray(distance, dtype=np.float64) / b0))


@dataclass(frozen=True, kw_only=True)
class EveryObjectFocus:
    """Unlimited focus, at the cost of a mechanism in each lens and one exposure for each depth of field.

    Parameters
    ----------
    lens
        One of the lenses.
    sample_pitch
        The pixel pitch [m].
    mechanisms
        Number of moving lenses.
    """

    lens: Lens
    sample_pitch: float
    mechanisms: int

    def __post_init__(self) -> None:
        require_positive("pixel pitch", self.sample_pitch)

    def sharp_range(self, criterion: BlurCriterion) -> SharpRange:
        """Everything beyond the focal length, one focus after another, unless diffraction alone exceeds the criterion.

        The diffraction spot at a is ``d∞ b(a)/f`` wide. It meets the criterion from the distance where ``b = f c/d∞``.
        """
        f = self.lens.focal_length
        at_infinity = criterion.allowance(self.sample_pitch, self.lens.f_number)
        if bool(at_infinity.exceeded):
            nothing = DepthOfField(near=np.asarray(np.nan), far=np.asarray(np.nan))
            return sharp_range(("refocused",), [nothing], at_infinity.reason)
        spot = float(diffraction_diameter(criterion.wavelength, self.lens.f_number, criterion.measure))
        widest = criterion.blur_px * self.sample_pitch
        # b − f = f (c/d∞ − 1) is the largest focus shift that is still sharp.
        near = f + f * spot / (widest - spot) if widest > spot else math.inf
        return sharp_range(("refocused",), [DepthOfField(near=np.asarray(near), far=np.asarray(math.inf))])

    def sharp_range_at_resolution(self, resolution: float, wavelength: float) -> SharpRange:
        """From the focal length to the nearer of ``p (a − f)/f = r`` and ``1.22 λ a/A = r``."""
        f = self.lens.focal_length
        diffraction = resolution / float(airy_radius(1.0, self.lens.pupil_diameter, wavelength))
        far = min(f + f * (resolution / self.sample_pitch), diffraction)
        if far < f:
            nothing = DepthOfField(near=np.asarray(np.nan), far=np.asarray(np.nan))
            return sharp_range(("refocused",), [nothing], "diffraction is coarser at every distance")
        return sharp_range(("refocused",), [DepthOfField(near=np.asarray(f), far=np.asarray(far))])

    def images(self, criterion: BlurCriterion, near: float, far: float) -> int:
        """Number of depths of field that cover the scene; 0 if diffraction exceeds the criterion at its near end."""
        f = self.lens.focal_length
        if not near > f:
            return 0
        f_number = image_distance(near, f) / self.lens.pupil_diameter
        blur = float(criterion.allowance(self.sample_pitch, f_number).geometric_diameter)
        if not blur > 0.0:
            return 0
        return images_needed(near, far, focal_length=f, pupil_diameter=self.lens.pupil_diameter, blur_diameter=blur)

    def lateral_resolution(self, distance: ArrayLike, wavelength: float) -> LateralResolution:
        """``p (a − f)/f``, size of a pixel on an object in focus, no blur, and ``1.22 λ a/A`` [m]."""
        a, f = np.asarray(distance, dtype=np.float64), self.lens.focal_length
        real = np.where(a > f, 1.0, np.nan)
        return LateralResolution(
            sampling=np.asarray(real * self.sample_pitch * ((a - f) / f)),
            blur=np.asarray(0.0 * real),
            diffraction=np.asarray(real * airy_radius(a, self.lens.pupil_diameter, wavelength)),
        )

    def diffraction_width(self, distance: ArrayLike, wavelength: float, measure: DiffractionMeasure) -> FloatArray:
        """Width ``∝ λ a/A`` [m] of the diffraction spot on an object in focus; on the sensor it is ``∝ λ b/A``."""
        a, f = np.asarray(distance, dtype=np.float64), self.lens.focal_length
        spot = diffraction_diameter(wavelength, 1.0 / self.lens.pupil_diameter, measure)
        return np.asarray(np.where(a > f, spot * a, np.nan))
