"""What a study asks of wave optics: where Fresnel may replace Kirchhoff, and how far points spread."""

from __future__ import annotations

import itertools
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from tradestudy import units
from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.part import Part
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
# What the propagators accept; double precision ends below.
IntensityTolerance = Annotated[float, *quantity(units.FRACTION, at_least=1e-10, at_most=0.1)]
PositiveWaves = Annotated[Waves, Field(gt=0)]


class FNumberRangePart(Part):
    """F-numbers on a logarithmic scale."""

    start: FNumber = Field(alias="from", description="Smallest f-number.")
    stop: FNumber = Field(alias="to", description="Largest f-number.")
    points: Annotated[int, Field(ge=2, le=200, strict=True)] = Field(
        description="How many f-numbers, both ends included."
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
    """F-numbers one by one, however they were written."""
    return f_numbers.values() if isinstance(f_numbers, FNumberRangePart) else f_numbers


class PublishedErrorPart(Part):
    """An error that somebody read off for this lens."""

    f_number: FNumber = Field(description="F-number of the published point.")
    error: PositiveFraction = Field(description="Published error at that f-number.")


class ElementPart(Part):
    """One lens and the object it images, in focus."""

    title: Annotated[str, Field(min_length=1, max_length=80)] = Field(description="What reports call this lens.")
    focal_length: FocalLength = Field(description="Focal length of the lens.")
    object_distance: ObjectDistance = Field(description="Distance from the lens to the point source.")
    f_number: FNumber = Field(description="At which the camera uses it.")
    published_error: PublishedErrorPart | None = Field(default=None, description="A published point to compare with.")
    published_minimum_f_number: PositiveNumber | None = Field(
        default=None, description="A published least f-number for Fresnel to compare with."
    )

    @model_validator(mode="after")
    def _real_image(self) -> Self:
        if not self.object_distance > self.focal_length:
            raise MistakeAt(("object_distance",), "must exceed the focal length: a real image is compared")
        return self

    @property
    def image_distance(self) -> float:
        """In-focus image distance b = a f/(a − f) [m]."""
        return self.object_distance * self.focal_length / (self.object_distance - self.focal_length)


class OffAxisPart(Part):
    """One direction away from the axis, in light of one wavelength: without symmetry it takes long."""

    field_angle: PositiveAngle = Field(description="Direction of the object point against the axis.")
    wavelength: PositiveWavelength = Field(description="Wavelength at which the off-axis error is evaluated.")


class FresnelValidityPart(Part):
    """Measured difference of Fresnel's point-spread function from Kirchhoff's, and the criteria that predict it."""

    elements: Annotated[dict[ElementName, ElementPart], Field(min_length=1, max_length=10)] = Field(
        description="Lenses by name."
    )
    f_numbers: FNumbers = Field(description="Increasing, one by one or as a range.")
    wavelengths: Annotated[tuple[PositiveWavelength, ...], Field(min_length=1, max_length=20)] = Field(
        description="Wavelengths to evaluate."
    )
    lens_phases: Annotated[tuple[LensPhaseName, ...], Field(min_length=1, max_length=3)] = Field(
        description="Phases of the lens to evaluate."
    )
    off_axis: OffAxisPart | None = Field(default=None, description="The comparison away from the axis.")
    windows: Annotated[tuple[PositiveNumber, ...], Field(min_length=1, max_length=6)] = Field(
        description="Radii of the windows over which point-spread functions are compared, in Airy radii."
    )
    path_errors: Annotated[tuple[PositiveWaves, ...], Field(min_length=1, max_length=6)] = Field(
        description="Bounds of the dropped path for the bounded criterion."
    )
    error_limit: PositiveFraction = Field(description="Error up to which Fresnel counts as good enough.")
    tolerance: IntensityTolerance = Field(description="Relative numerical error of each computed intensity.")

    @model_validator(mode="after")
    def _in_order(self) -> Self:
        increasing = {"f_numbers": listed(self.f_numbers), "wavelengths": self.wavelengths, "windows": self.windows}
        for name, values in increasing.items():
            if any(not a < b for a, b in itertools.pairwise(values)):
                raise MistakeAt((name,), "must increase")
        if len(set(self.lens_phases)) < len(self.lens_phases):
            raise MistakeAt(("lens_phases",), "names one twice")
        return self


class PointSpreadPart(Part):
    """How far points spread behind each lens: one thing varied at a time from the lens as it stands."""

    elements: Annotated[dict[ElementName, ElementPart], Field(min_length=1, max_length=10)] = Field(
        description="Lenses by name."
    )
    lens_phase: LensPhaseName = Field(description="Phase that each lens adds.")
    pixel_pitch: PixelPitch = Field(description="Of the pixels whose neighbours are counted.")
    window: PositiveNumber = Field(description="Half the side of the sampled window, in Airy radii of each lens.")
    rms_radius: PositiveNumber = Field(description="Radius within which the rms width is taken, in Airy radii.")
    f_numbers: FNumbers = Field(description="One by one or as a range.")
    wavelengths: Annotated[tuple[PositiveWavelength, ...], Field(min_length=1, max_length=20)] = Field(
        description="Wavelengths to evaluate."
    )
    field_angles: Annotated[tuple[NonNegativeAngle, ...], Field(min_length=1, max_length=20)] = Field(
        description="Angles from the axis to evaluate."
    )
    reference_wavelength: PositiveWavelength = Field(description="While something else is varied.")
    defocus: Annotated[tuple[Waves, ...], Field(min_length=1, max_length=20)] = Field(
        description="Distance of the object from focus, in waves of path at the rim of the pupil; > 0 is nearer."
    )
    tolerance: IntensityTolerance = Field(description="Largest error of the intensity, relative to its peak.")
