"""Wave optics in studies: where Fresnel may replace Kirchhoff, and how wide points spread."""

from __future__ import annotations

import itertools
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from tradestudy import units
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    FNumber,
    FocalLength,
    NonNegativeAngle,
    ObjectDistance,
    PixelPitch,
    PositiveAngle,
    PositiveFraction,
    PositiveNumber,
    PositiveWavelength,
    Waves,
    quantity,
)

ElementName = Annotated[str, Field(pattern=r"^[\w][\w.+-]*$", max_length=60)]
LensPhaseName = Literal["parabolic", "stigmatic", "perfect"]
PsfMetric = Literal["peak", "l1", "largest"]
# The propagators accept no less: it would be beyond double precision.
IntensityTolerance = Annotated[float, *quantity(units.FRACTION, at_least=1e-10, at_most=0.1)]
PositiveWaves = Annotated[float, *quantity(units.WAVES, above=0.0)]


class FNumberRangePart(Part):
    """A range of f-numbers with logarithmic spacing."""

    start: FNumber = Field(alias="from", description="Smallest f-number.")
    stop: FNumber = Field(alias="to", description="Largest f-number.")
    points: Annotated[int, Field(ge=2, le=200, strict=True)] = Field(
        description="Number of f-numbers, including both ends."
    )

    @model_validator(mode="after")
    def _increasing(self) -> Self:
        if not self.start < self.stop:
            raise MistakeAt(("to",), "must lie beyond from")
        return self

    def values(self) -> tuple[float, ...]:
        """The f-numbers; the ends exactly as written."""
        return tuple(float(value) for value in np.geomspace(self.start, self.stop, self.points))


FNumbers = Annotated[tuple[FNumber, ...], Field(min_length=1, max_length=200)] | FNumberRangePart


def listed(f_numbers: FNumbers) -> tuple[float, ...]:
    """The f-numbers of a list or a range."""
    return f_numbers.values() if isinstance(f_numbers, FNumberRangePart) else f_numbers


class PublishedErrorPart(Part):
    """A published error of Fresnel's approximation for this lens."""

    f_number: FNumber = Field(description="F-number to which the published error applies.")
    error: PositiveFraction = Field(description="Published error of the point-spread function at this f-number.")


class ElementPart(Part):
    """A lens, and the object point on which it is focused."""

    title: Annotated[str, Field(min_length=1, max_length=80)] = Field(description="Name of the lens in the report.")
    focal_length: FocalLength = Field(description="Focal length of the lens.")
    object_distance: ObjectDistance = Field(
        description="Distance from the lens to the object point; it must exceed the focal length."
    )
    f_number: FNumber = Field(description="F-number at which the camera uses the lens.")
    published_error: PublishedErrorPart | None = Field(
        default=None,
        description="A published error of Fresnel's approximation; `fresnel_validity` compares it with the computed "
        "error.",
    )
    published_minimum_f_number: PositiveNumber | None = Field(
        default=None,
        description="A published minimum f-number for Fresnel's approximation; the report compares it with the "
        "computed minimum f-numbers.",
    )

    @model_validator(mode="after")
    def _real_image(self) -> Self:
        if not self.object_distance > self.focal_length:
            raise MistakeAt(("object_distance",), "must exceed the focal length, since real images are compared")
        return self

    @property
    def image_distance(self) -> float:
        """In-focus image distance b = a f/(a − f) [m]."""
        return self.object_distance * self.focal_length / (self.object_distance - self.focal_length)


class OffAxisPart(Part):
    """A comparison at one object point off the axis and at one wavelength."""

    field_angle: PositiveAngle = Field(
        description="Angle between the optical axis and the direction of the object point."
    )
    wavelength: PositiveWavelength = Field(description="Wavelength at which the off-axis error is evaluated.")


class FresnelValidityPart(Part):
    """The error of point-spread functions computed by Fresnel's approximation, relative to Kirchhoff's integral.

    The error is acceptable from some f-number on; the report compares this f-number with those that closed-form
    criteria give.
    """

    elements: Annotated[dict[ElementName, ElementPart], Field(min_length=1, max_length=10)] = Field(
        description="Lenses to evaluate, by name."
    )
    f_numbers: FNumbers = Field(description="F-numbers to evaluate: a range or an increasing list.")
    wavelengths: Annotated[tuple[PositiveWavelength, ...], Field(min_length=1, max_length=20)] = Field(
        description="Wavelengths to evaluate, in increasing order."
    )
    lens_phases: Annotated[tuple[LensPhaseName, ...], Field(min_length=1, max_length=3)] = Field(
        description="Lens phases to evaluate; see light_spot.main_lens.lens_phase for their meaning."
    )
    off_axis: OffAxisPart | None = Field(
        default=None,
        description="A comparison of Fresnel's approximation with Kirchhoff's integral at one point off the axis; "
        "default: none.",
    )
    windows: Annotated[tuple[PositiveNumber, ...], Field(min_length=1, max_length=6)] = Field(
        description="Radii, in Airy radii and in increasing order, of the windows over which the point-spread "
        "functions are compared."
    )
    path_errors: Annotated[tuple[PositiveWaves, ...], Field(min_length=1, max_length=6)] = Field(
        description="Bounds on the optical path that Fresnel's approximation neglects; each gives a minimum f-number."
    )
    error_limit: PositiveFraction = Field(
        description="Largest acceptable error of a point-spread function computed by Fresnel's approximation. It "
        "applies to each of the three measures of the error (peak, l1 and largest); the key `metric` of a claim with "
        "`quantity: psf_error` explains them."
    )
    tolerance: IntensityTolerance = Field(
        description="Largest acceptable relative numerical error of each computed point-spread function, in the L2 "
        "norm."
    )

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        increasing = {"f_numbers": listed(self.f_numbers), "wavelengths": self.wavelengths, "windows": self.windows}
        for name, values in increasing.items():
            if any(not a < b for a, b in itertools.pairwise(values)):
                raise MistakeAt((name,), "must increase")
        if len(set(self.lens_phases)) < len(self.lens_phases):
            raise MistakeAt(("lens_phases",), "repeats a phase; name each once")
        return self


class PointSpreadPart(Part):
    """How the image that a lens forms of a point changes with f-number, wavelength, field angle and defocus."""

    elements: Annotated[dict[ElementName, ElementPart], Field(min_length=1, max_length=10)] = Field(
        description="Lenses to evaluate, by name."
    )
    lens_phase: LensPhaseName = Field(
        description="Phase that each lens adds; see light_spot.main_lens.lens_phase for the meaning of the names."
    )
    pixel_pitch: PixelPitch = Field(
        description="Pixel pitch for which the report states the modulation transfer at half the Nyquist frequency, "
        "and the light on neighbouring pixels."
    )
    window: PositiveNumber = Field(
        description="Half the side of the square in which the image of a point is computed, in Airy radii of each lens."
    )
    rms_radius: PositiveNumber = Field(
        description="Radius within which the root-mean-square width is computed, in Airy radii."
    )
    f_numbers: FNumbers = Field(description="F-numbers to evaluate: a range or a list.")
    wavelengths: Annotated[tuple[PositiveWavelength, ...], Field(min_length=1, max_length=20)] = Field(
        description="Wavelengths to evaluate."
    )
    field_angles: Annotated[tuple[NonNegativeAngle, ...], Field(min_length=1, max_length=20)] = Field(
        description="Field angles to evaluate, measured from the optical axis."
    )
    reference_wavelength: PositiveWavelength = Field(
        description="Wavelength that applies while another quantity is varied, and for which the report states the "
        "Airy radius. Values given in Airy radii refer to the Airy radius at the wavelength and f-number of each "
        "computed image."
    )
    defocus: Annotated[tuple[Waves, ...], Field(min_length=1, max_length=20)] = Field(
        description="Defocus, as the path difference at the rim of the pupil in waves; above 0, the object is nearer "
        "than the distance in focus."
    )
    tolerance: IntensityTolerance = Field(
        description="Largest acceptable numerical error of the intensity, relative to its peak."
    )
