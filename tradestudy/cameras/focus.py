"""Depth of field, resolution and number of images of lenses: what all kinds share, one lens, and refocused lenses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from tradestudy.cameras.parts import Lens, require_positive
from tradestudy.errors import OutOfRangeError
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

# Ten times the magnification of the strongest microscope objectives: no sensor lies so far behind its lens.
_LARGEST_MAGNIFICATION = 1000.0


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
    """The focus of a camera along its optical axis; distances count as all distances of the camera do."""

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


def require_focus(focus_distance: float, lens: Lens, what: str = "lens") -> None:
    """Refuse a focus [m] from the entrance pupil that is not in front of the lens, or at which it magnifies too much.

    The focus must lie beyond the front focal point F; the magnification is ``f/(Z₀ − F)`` at the focus distance Z₀.
    """
    nearest = max(lens.front_focus, 0.0)
    if not focus_distance > nearest:
        limit = "beyond the front focal point" if lens.entrance_pupil else "beyond the focal length"
        raise OutOfRangeError(
            f"the {what} cannot focus that close",
            value=f"{focus_distance * 1e3:g} mm",
            limit=f"{limit}, {nearest * 1e3:g} mm",
            remedy="increase the focus distance",
        )
    magnification = lens.focal_length / (focus_distance - lens.front_focus)
    if magnification > _LARGEST_MAGNIFICATION:
        behind = lens.focal_length * (1.0 + magnification)
        raise OutOfRangeError(
            f"magnification of the {what} at {focus_distance * 1e3:.9g} mm, just beyond the front focal point",
            value=f"{magnification:.3g} times, with the sensor {behind:.3g} m behind",
            limit=f"at most {_LARGEST_MAGNIFICATION:g} times",
            remedy="increase the focus distance",
        )


def require_refocusing(lens: Lens) -> None:
    """Refuse a lens that refocuses and has its entrance pupil in front of its front focal point."""
    if lens.front_focus < 0.0:
        raise OutOfRangeError(
            "entrance_pupil of a lens that refocuses lies in front of the front focal point",
            value=f"{lens.entrance_pupil * 1e3:g} mm",
            limit=f"{-lens.focal_length * 1e3:g} mm or more",
            remedy="give the camera one fixed focus distance, or correct the pupil",
        )


def refocusing(lens: Lens, blur: float) -> dict[str, float]:
    """The thin lens, by the arguments of `images_needed`, whose stack has the focus distances of a lens with its pupil.

    For distances Z from the entrance pupil, blur on the sensor is A f |Z − Z₀|/(Z (Z₀ − F)): f/F times that of the thin
    lens of focal length F = f + e. For a pupil in the front focal point, F is replaced by a millionth of f.
    """
    front = max(lens.front_focus, 1e-6 * lens.focal_length)
    return {
        "focal_length": front,
        "pupil_diameter": lens.pupil_diameter,
        "blur_diameter": blur * (front / lens.focal_length),
    }


@dataclass(frozen=True, kw_only=True)
class SingleLensFocus:
    """A thin lens with fixed focus.

    Parameters
    ----------
    lens
        The lens; see `Lens.thin` for others.
    focus_distance
        Focus distance a₀ [m] from it; infinity is allowed.
    sample_pitch
        The pixel pitch [m].
    name
        Name of its only slice.
    lens_behind
        How far behind the point from which the distances of the results count the lens lies [m].

    Raises
    ------
    OutOfRangeError
        For a focus inside the focal length or a pitch that is not positive.
    """

    lens: Lens
    focus_distance: float
    sample_pitch: float
    name: str = "one image"
    lens_behind: float = 0.0

    mechanisms = 0

    def __post_init__(self) -> None:
        require_positive("pixel pitch", self.sample_pitch)
        require_focus(self.focus_distance, self.lens)

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
        return sharp_range((self.name,), [self._counted(limits)], allowance.reason)

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
        return sharp_range((self.name,), [self._counted(limits)])

    def _counted(self, limits: DepthOfField) -> DepthOfField:
        return replace(limits, near=limits.near - self.lens_behind, far=limits.far - self.lens_behind)

    def images(self, criterion: BlurCriterion, near: float, far: float) -> int:  # noqa: ARG002 - one, whatever the scene
        """Always one."""
        return 1

    def lateral_resolution(self, distance: ArrayLike, wavelength: float) -> LateralResolution:
        """``p a/b₀``, ``A |a − a₀|/a₀`` and ``1.22 λ a/A`` [m]; see `lateral_resolution`."""
        return lateral_resolution(
            np.asarray(distance) + self.lens_behind,
            focus_distance=self.focus_distance,
            focal_length=self.lens.focal_length,
            pupil_diameter=self.lens.pupil_diameter,
            sample_pitch=self.sample_pitch,
            wavelength=wavelength,
        )


@dataclass(frozen=True, kw_only=True)
class EveryObjectFocus:
    """Unlimited focus, at the cost of a mechanism in each lens and one exposure for each depth of field.

    Parameters
    ----------
    lens
        One of the lenses; distances count from its entrance pupil.
    sample_pitch
        The pixel pitch [m].
    mechanisms
        Number of moving lenses.

    Raises
    ------
    OutOfRangeError
        The entrance pupil lies in front of the front focal point.
    """

    lens: Lens
    sample_pitch: float
    mechanisms: int

    def __post_init__(self) -> None:
        require_positive("pixel pitch", self.sample_pitch)
        require_refocusing(self.lens)

    def sharp_range(self, criterion: BlurCriterion) -> SharpRange:
        """Everything beyond the front focal point, unless diffraction alone exceeds the criterion.

        The lens is focused on one object after another. The diffraction spot at a is ``d∞ a/(a − F)`` wide, with F the
        distance of that point.
        """
        front = self.lens.front_focus
        at_infinity = criterion.allowance(self.sample_pitch, self.lens.f_number)
        if bool(at_infinity.exceeded):
            nothing = DepthOfField(near=np.asarray(np.nan), far=np.asarray(np.nan))
            return sharp_range(("refocused",), [nothing], at_infinity.reason)
        spot = float(diffraction_diameter(criterion.wavelength, self.lens.f_number, criterion.measure))
        widest = criterion.blur_px * self.sample_pitch
        near = front + front * spot / (widest - spot) if widest > spot else math.inf
        return sharp_range(("refocused",), [DepthOfField(near=np.asarray(near), far=np.asarray(math.inf))])

    def sharp_range_at_resolution(self, resolution: float, wavelength: float) -> SharpRange:
        """From the front focal point F to the nearer of ``p (a − F)/f = r`` and ``1.22 λ a/A = r``."""
        f, front = self.lens.focal_length, self.lens.front_focus
        diffraction = resolution / float(airy_radius(1.0, self.lens.pupil_diameter, wavelength))
        far = min(front + f * (resolution / self.sample_pitch), diffraction)
        if far < front:
            nothing = DepthOfField(near=np.asarray(np.nan), far=np.asarray(np.nan))
            return sharp_range(("refocused",), [nothing], "diffraction is coarser at every distance")
        return sharp_range(("refocused",), [DepthOfField(near=np.asarray(front), far=np.asarray(far))])

    def images(self, criterion: BlurCriterion, near: float, far: float) -> int:
        """Number of depths of field that cover the scene; 0 if diffraction exceeds the criterion at its near end."""
        if not near > self.lens.front_focus:
            return 0
        thin = self.lens.thin(near)
        f_number = image_distance(near, thin.focal_length) / thin.pupil_diameter
        blur = float(criterion.allowance(self.sample_pitch, f_number).geometric_diameter)
        if not blur > 0.0:
            return 0
        return images_needed(near, far, **refocusing(self.lens, blur))

    def lateral_resolution(self, distance: ArrayLike, wavelength: float) -> LateralResolution:
        """``p (a − F)/f``, size of a pixel on an object in focus, no blur, and ``1.22 λ a/A`` [m]."""
        a, f, front = np.asarray(distance, dtype=np.float64), self.lens.focal_length, self.lens.front_focus
        real = np.where(a > front, 1.0, np.nan)
        return LateralResolution(
            sampling=np.asarray(real * self.sample_pitch * ((a - front) / f)),
            blur=np.asarray(0.0 * real),
            diffraction=np.asarray(real * airy_radius(a, self.lens.pupil_diameter, wavelength)),
        )
