"""Wave optics in studies: Fresnel against Kirchhoff, the image of a point, and a spot of light behind microlenses."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import BeforeValidator, Field
from pydantic_core import PydanticKnownError

from tradestudy import units
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    FNumber,
    FocalLength,
    Length,
    LensToSensor,
    MicrolensPitch,
    NonNegativeAngle,
    NonNegativeLength,
    ObjectDistance,
    PixelPitch,
    PositiveAngle,
    PositiveDuration,
    PositiveFraction,
    PositiveNumber,
    PositiveWavelength,
    Seed,
    Waves,
    quantity,
)
from tradestudy.effects import LENSES
from tradestudy.light_methods import legs_of
from tradestudy.study.schema.accuracy import EffectsPart
from tradestudy.units import LENGTH, UnitError, pretty

ElementName = Annotated[str, Field(pattern=r"^[\w][\w.+-]*$", max_length=60)]
LensPhaseName = Literal["parabolic", "stigmatic", "perfect"]
PsfMetric = Literal["peak", "l1", "largest"]
# The propagators accept no less: it would be beyond double precision.
IntensityTolerance = Annotated[float, *quantity(units.FRACTION, at_least=1e-10, at_most=0.1)]
PositiveWaves = Annotated[float, *quantity(units.WAVES, above=0.0)]


class FNumberRangePart(Part):
    """A range of f-numbers with logarithmic spacing."""

    increasing = ("start", "stop")

    start: FNumber = Field(alias="from", description="Smallest f-number.")
    stop: FNumber = Field(alias="to", description="Largest f-number.")
    points: Annotated[int, Field(ge=2, le=200, strict=True)] = Field(
        description="Number of f-numbers, including both ends."
    )

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

    def _mistakes(self) -> Iterator[MistakeAt]:
        if not self.object_distance > self.focal_length:
            yield MistakeAt(("object_distance",), "must exceed the focal length, since real images are compared")

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

    def _mistakes(self) -> Iterator[MistakeAt]:
        increasing = {"f_numbers": listed(self.f_numbers), "wavelengths": self.wavelengths, "windows": self.windows}
        for name, values in increasing.items():
            if any(not a < b for a, b in itertools.pairwise(values)):
                yield MistakeAt((name,), "must increase")
        if len(set(self.lens_phases)) < len(self.lens_phases):
            yield MistakeAt(("lens_phases",), "repeats a phase; name each once")


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


# One method for both legs, or one for the leg to the array and one for the leg behind it.
MethodName = Literal[
    "geometric", "exact-rays", "boundary-wave", "fresnel", "kirchhoff",
    "geometric-boundary-wave", "geometric-fresnel", "geometric-kirchhoff",
    "boundary-wave-geometric", "boundary-wave-fresnel", "boundary-wave-kirchhoff",
    "fresnel-geometric", "fresnel-boundary-wave", "fresnel-kirchhoff",
    "kirchhoff-geometric", "kirchhoff-boundary-wave", "kirchhoff-fresnel",
]  # fmt: skip
# A smaller tolerance is beyond double precision; a larger one gives no useful picture.
LOOSEST_PICTURE: Final = 0.2
ImageTolerance = Annotated[float, *quantity(units.FRACTION, at_least=1e-6, at_most=LOOSEST_PICTURE)]
Weight = Annotated[float, *quantity(units.NUMBER, at_least=0.0)]

_ROUNDING: Final = 1e-12  # relative, of widths computed as quotients
_NO_RAYS: Final = "rays have no phase, but light_spot.spot is coherent; use fresnel or kirchhoff, or remove coherent"
_NO_EDGE: Final = (
    "boundary waves apply to single points, but light_spot.spot is coherent; use fresnel or kirchhoff, or remove "
    "coherent"
)
_NO_SQUARE_EDGE: Final = (
    "boundary waves need circular apertures, but light_spot.microlenses.aperture is square; use kirchhoff, which "
    "computes the same integral"
)
_WIDENED: Final = 2.0  # by aberrations, and between array and detector: less is not certain to miss them
_WIDEST_SQUARE_IN_HEXAGON: Final = math.sqrt(3.0) - 1.0  # side over pitch, sides along the rows


def _no_list(value: object) -> object:
    """Refuse lists, so that pydantic reports a list once, not also as a length."""
    if isinstance(value, list | tuple):
        if len(value) == 1:
            raise UnitError("this list has only one value; the value without brackets")
        raise PydanticKnownError("float_type")
    return value


OneLength = Annotated[FocalLength, BeforeValidator(_no_list)]


class MainLensPart(Part):
    """The main lens in the light path."""

    focal_length: FocalLength = Field(description="Focal length of the main lens.")
    f_number: FNumber = Field(description="F-number: focal length divided by the diameter of the aperture.")
    lens_phase: LensPhaseName = Field(
        description="Phase that the lens adds. A `perfect` lens images every point without aberration. A `stigmatic` "
        "lens does so only for the point on the axis that is in focus. A `parabolic` lens, as in the paper, has "
        "spherical aberration."
    )


class SpotMicrolensesPart(Part):
    """An array of equally wide microlenses, centred on the axis, with one or several focal lengths."""

    layout: Literal["square", "hexagonal"] = Field(
        default="square", description="Arrangement of the microlenses; the rows of a hexagonal array run along x."
    )
    lenses_across: Annotated[int, Field(ge=1, le=15, strict=True)] = Field(
        description="Number of microlenses along one side of a square array, or (an odd number) along the "
        "middle row of a hexagonal array."
    )
    pitch: MicrolensPitch = Field(description="Distance between the centres of neighbouring microlenses.")
    focal_length: OneLength | Annotated[tuple[FocalLength, ...], Field(min_length=2, max_length=4)] = Field(
        description="Focal length of all microlenses, or a list with that of each type. The types take turns along "
        "each row, in the order of the list towards +x. From each row to the next towards +y, this sequence moves "
        "towards +x: by one pitch in a square array, by one and a half in a hexagonal one. The first type is on the "
        "axis; in a square array with an even number of microlenses along a side, which has none on the axis, it is on "
        "the diagonal x = y."
    )
    aperture: Literal["circular", "square"] = Field(default="circular", description="Shape of each microlens aperture.")
    f_number: FNumber | None = Field(
        default=None,
        description="F-number of the microlenses: focal length divided by aperture width; only with a single focal "
        "length.",
    )
    aperture_width: MicrolensPitch | None = Field(
        default=None, description="Instead of f_number: diameter of circular apertures, or side of square ones."
    )
    gap: LensToSensor = Field(description="Distance from the array to the detector.")
    interstices: Literal["opaque", "clear"] = Field(
        description="Whether light passes between the apertures of the microlenses (`clear`) or not (`opaque`)."
    )
    lens_phase: LensPhaseName = Field(
        description="Phase that each microlens adds; see light_spot.main_lens.lens_phase for the meaning of the names. "
        "Only `parabolic` is the same for every source; a picture by Kirchhoff's integral is refused if another phase "
        "changes it by more than its tolerance, as near focus, or seems to by an estimate before the run."
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if mistakes := [*self._mistakes_of_width(), *self._mistakes_of_arrangement()]:
            yield MistakeAt.several(mistakes)

    def _mistakes_of_width(self) -> Iterator[MistakeAt]:
        if (self.f_number is None) == (self.aperture_width is None):
            yield MistakeAt((), "give exactly one of f_number and aperture_width")
            return
        if self.f_number is not None and len(self.focal_lengths) > 1:
            yield MistakeAt(
                ("f_number",), "applies to a single focal length; give aperture_width, which all types share"
            )
            return
        key = "f_number" if self.aperture_width is None else "aperture_width"
        widest = self.pitch * _WIDEST_SQUARE_IN_HEXAGON
        if self.width > self.pitch * (1.0 + _ROUNDING):
            yield MistakeAt((key,), "makes the microlenses wider than their pitch")
        elif (self.layout, self.aperture) == ("hexagonal", "square") and self.width > widest * (1.0 + _ROUNDING):
            yield MistakeAt(
                (key,),
                "square apertures would overlap in a hexagonal array; a side of at most "
                f"{pretty(widest, LENGTH)} is expected",
            )

    def _mistakes_of_arrangement(self) -> Iterator[MistakeAt]:
        kinds = len(self.focal_lengths)
        if self.layout == "hexagonal" and self.lenses_across % 2 == 0:
            yield MistakeAt(
                ("lenses_across",),
                f"{self.lenses_across} across gives no hexagon centred on a microlens; give an odd number",
            )
        if len(set(self.focal_lengths)) < kinds:
            yield MistakeAt(("focal_length",), "repeats a value; give each focal length once")
        if kinds > 2 * self.lenses_across - 1:  # number of diagonals, each of one type
            yield MistakeAt(
                ("focal_length",),
                f"an array of {self.lenses_across} across does not contain all {kinds} types; make it larger",
            )

    @property
    def focal_lengths(self) -> tuple[float, ...]:
        """Focal length of each type [m]."""
        return self.focal_length if isinstance(self.focal_length, tuple) else (self.focal_length,)

    @property
    def width(self) -> float:
        """Diameter or side of the apertures [m]."""
        if self.aperture_width is not None:
            return self.aperture_width
        assert self.f_number is not None  # the validator requires one of the two
        return self.focal_lengths[0] / self.f_number


class SpotDetectorPart(Part):
    """The pixels of a square detector, centred on the axis."""

    pixels: Annotated[int, Field(ge=3, le=1000, strict=True)] = Field(
        description="Number of pixels along each side of the square detector."
    )
    pixel_pitch: PixelPitch = Field(description="Distance between the centres of neighbouring pixels.")


class SpotSourcePart(Part):
    """The light source: a uniformly bright disc, or a point."""

    diameter: NonNegativeLength = Field(description="Diameter of the disc; 0 mm makes it a point.")
    distance: ObjectDistance = Field(description="Distance from the main lens to the source.")
    x: Length = Field(default=0.0, description="Horizontal offset of the source from the axis.")
    y: Length = Field(default=0.0, description="Vertical offset of the source from the axis.")
    coherent: bool = Field(
        default=False,
        description="Whether all points of the disc radiate in phase; otherwise they radiate incoherently.",
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if self.coherent and self.is_point:
            yield MistakeAt(("coherent",), "has no effect on a point; give a diameter, or remove coherent")

    @property
    def is_point(self) -> bool:
        """Whether the source is a point."""
        return self.diameter == 0.0


class SpectrumPart(Part):
    """Light of several wavelengths, whose intensities add."""

    wavelengths: Annotated[tuple[PositiveWavelength, ...], Field(min_length=2, max_length=20)] = Field(
        description="Wavelengths of the light, in increasing order."
    )
    weights: Annotated[tuple[Weight, ...], Field(min_length=2, max_length=20)] = Field(
        description="Power of the light in the pupil at each of the wavelengths, in the same order; only ratios matter."
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        mistakes = []
        if any(not a < b for a, b in itertools.pairwise(self.wavelengths)):
            mistakes.append(MistakeAt(("wavelengths",), "must increase"))
        if len(self.weights) != len(self.wavelengths):
            what = f"{len(self.weights)} weights for {len(self.wavelengths)} wavelengths: give one for each"
            mistakes.append(MistakeAt(("weights",), what))
        if not any(self.weights):
            mistakes.append(MistakeAt(("weights",), "all are zero: there is no light"))
        if mistakes:
            yield MistakeAt.several(mistakes)


class PublishedTimePart(Part):
    """A published computing time for the picture that `light_spot` declares."""

    method: MethodName = Field(description="Method that was timed; see light_spot.methods.")
    says: Annotated[str, Field(min_length=1, max_length=80)] = Field(description="The time in the words of its source.")
    takes: PositiveDuration | None = Field(default=None, description="The time as a number, if the source states one.")
    source: Annotated[str, Field(min_length=1, max_length=200)] = Field(description="Where the time was published.")


class LightSpotPart(Part):
    """The picture of a spot of light taken through a main lens and microlenses, computed by several methods."""

    main_lens: MainLensPart
    mla_distance: LensToSensor = Field(description="Distance from the main lens to the microlens array.")
    microlenses: SpotMicrolensesPart
    detector: SpotDetectorPart
    spot: SpotSourcePart
    wavelength: PositiveWavelength | None = Field(
        default=None, description="Wavelength of the light, if it has only one."
    )
    spectrum: SpectrumPart | None = Field(
        default=None, description="Instead of `wavelength`: light of several wavelengths."
    )
    methods: Annotated[tuple[MethodName, ...], Field(max_length=4)] = Field(
        default=(),
        description="Methods whose pictures are compared; the one that the program chooses is always included. The "
        "names mean: paraxial rays (`geometric`); rays without the paraxial approximation (`exact-rays`); rays and the "
        "wave diffracted at the edge of the aperture (`boundary-wave`); Fresnel's approximation (`fresnel`); "
        "Kirchhoff's integral (`kirchhoff`). A pair of names, such as `kirchhoff-fresnel`, gives the method up to the "
        "microlens array and the method behind it.",
    )
    tolerance: ImageTolerance = Field(
        default=0.01,
        description="Largest acceptable relative numerical error of each compared picture, in the L2 norm; only if "
        "`methods` is given.",
    )
    seed: Seed = Field(default=0, description="Seed of the random points at which the pictures are checked.")
    benchmarks: bool = Field(
        default=False,
        description="Whether the run also measures how long Kirchhoff's integral takes for light from one point. Two "
        "cases are timed: the main lens alone (for each value of `lens_phase`, on and off the axis), and the main lens "
        "and the microlenses together.",
    )
    published_times: Annotated[tuple[PublishedTimePart, ...], Field(max_length=20)] = Field(
        default=(), description="Published computing times, shown next to the measured ones."
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if mistakes := [*self._mistakes_of_comparison(), *self._mistakes_of_light()]:
            yield MistakeAt.several(mistakes)

    def _mistakes_of_comparison(self) -> Iterator[MistakeAt]:
        if len(set(self.methods)) < len(self.methods):
            yield MistakeAt(("methods",), "repeats a method; name each once")
        timed = [time.method for time in self.published_times]
        for index, method in enumerate(timed):
            if method in timed[:index]:
                what = f"{method!r} already has a published time; give one for each method"
                yield MistakeAt(("published_times", index, "method"), what)
            elif method not in self.methods:
                what = f"{method!r} is not one of light_spot.methods; add it there, or remove its time"
                yield MistakeAt(("published_times", index, "method"), what)
        if "tolerance" in self.model_fields_set and not self.methods:
            yield MistakeAt(
                ("tolerance",), "applies only to compared methods; give methods, or accuracy.pixel_intensity instead"
            )
        for index, method in enumerate(self.methods):
            if self.spot.coherent and (laws := set(legs_of(method))) - {"fresnel", "kirchhoff"}:
                yield MistakeAt(("methods", index), _NO_EDGE if "boundary-wave" in laws else _NO_RAYS)
            elif self.microlenses.aperture == "square" and legs_of(method)[1] == "boundary-wave":
                yield MistakeAt(("methods", index), _NO_SQUARE_EDGE)

    def _mistakes_of_light(self) -> Iterator[MistakeAt]:
        if (self.wavelength is None) == (self.spectrum is None):
            yield MistakeAt((), "give exactly one of wavelength and spectrum")
        if self.spot.distance == self.main_lens.focal_length:
            yield MistakeAt(
                ("spot", "distance"), "equals the focal length of the main lens, so the image lies at infinity"
            )
        elif self.microlenses.lens_phase != "parabolic" and self.main_image_distance == self.mla_distance:
            yield MistakeAt(
                ("microlenses", "lens_phase"), "is undefined when the image lies on the array; use parabolic"
            )
        if self.spot.distance != self.main_lens.focal_length:
            yield from self._mistakes_of_place()

    def _mistakes_of_place(self) -> Iterator[MistakeAt]:
        """Light that by rays lands beside the microlenses, and beside the detector if it passes beside microlenses."""
        lens, spot, array = self.main_lens, self.spot, self.microlenses
        radius, scale = lens.focal_length / lens.f_number / 2.0, self.mla_distance / spot.distance
        lit = radius * abs(1.0 - self.mla_distance / self.main_image_distance) + spot.diameter / 2.0 * scale
        half, what = array.lenses_across * array.pitch / 2.0, "microlenses reach"
        side = self.detector.pixels * self.detector.pixel_pitch / 2.0
        if array.interstices == "clear" and side > half:
            half, what = side, "detector reaches"
        for key in ("x", "y"):
            place = abs(getattr(spot, key)) * scale
            if place > (most := _WIDENED * (half + lit)):
                yield MistakeAt(
                    ("spot", key),
                    f"puts the light {pretty(place, LENGTH)} off the axis, but the {what} only to "
                    f"{pretty(half, LENGTH)}; at most {pretty(most / scale, LENGTH)} is expected",
                )

    @property
    def main_image_distance(self) -> float:
        """Image of the spot behind the main lens, b_M = a f/(a − f) [m]; negative where it is virtual."""
        focal_length = self.main_lens.focal_length
        return focal_length * self.spot.distance / (self.spot.distance - focal_length)

    @property
    def lines(self) -> tuple[tuple[float, float], ...]:
        """Wavelengths with light [m], each with its share of the power."""
        if self.spectrum is None:
            assert self.wavelength is not None  # the validator requires one of the two
            return ((self.wavelength, 1.0),)
        total = math.fsum(self.spectrum.weights)
        pairs = zip(self.spectrum.wavelengths, self.spectrum.weights, strict=True)
        return tuple((wavelength, weight / total) for wavelength, weight in pairs if weight > 0.0)

    @property
    def mean_wavelength(self) -> float:
        """Mean wavelength, weighted by power [m]."""
        if len(self.lines) == 1:
            return self.lines[0][0]
        return math.fsum(share * wavelength for wavelength, share in self.lines)


def law_mistakes(spot: LightSpotPart, effects: EffectsPart) -> list[MistakeAt]:
    """Models of diffraction that `effects` forces although they cannot apply to this spot or array."""
    forced = effects.forced()
    if spot.spot.coherent:
        words = {"off": _NO_RAYS, "boundary_wave": _NO_EDGE}
        return [MistakeAt(("effects", slot), words[law]) for slot in LENSES if (law := forced.get(slot, "")) in words]
    if spot.microlenses.aperture == "square" and forced.get("microlens_diffraction") == "boundary_wave":
        return [MistakeAt(("effects", "microlens_diffraction"), _NO_SQUARE_EDGE)]
    return []
