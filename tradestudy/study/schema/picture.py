"""What a camera's picture of the scene is made of: texture, light, sensor, and the window that is matched."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal, NamedTuple, Self

from pydantic import Field, PlainValidator, WithJsonSchema, model_validator

from tradestudy import units
from tradestudy.cameras.parts import Sensor
from tradestudy.declarations.matcher import MatcherPart
from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import (
    DETAIL,
    DetailSize,
    FNumber,
    NonNegativeElectrons,
    NonNegativeLength,
    PixelPitch,
    PositiveElectrons,
    PositiveFraction,
    PositiveNumber,
    PositivePhotons,
    PositiveWavelength,
    quantity,
)
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.light import Light, SensorNoise
from tradestudy.imaging.models import PictureSettings, Texture
from tradestudy.units import UnitError, parse, pretty


class Window(NamedTuple):
    """Side of the window that is matched, and what it is counted in."""

    size: float
    of: Literal["picture", "object"]


def _window(value: Any) -> Window:
    """Read "9 px" or "1 mm"."""
    try:
        window = Window(parse(value, units.PIXELS), "picture")
    except UnitError:
        try:
            window = Window(parse(value, units.LENGTH), "object")
        except UnitError:
            shown = "a list" if isinstance(value, list | tuple) else f"'{value}'"
            raise UnitError(
                f"{shown} is no window; pixels such as 9 px, or a length on the object such as 1 mm, are expected"
            ) from None
    if not 0.0 < window.size < float("inf"):
        raise UnitError(f"'{value}' is out of range; a window above 0 px or 0 m is expected")
    if window.of == "object" and not DETAIL.smallest <= window.size <= DETAIL.largest:
        ends = f"{pretty(DETAIL.smallest, units.LENGTH)} to {pretty(DETAIL.largest, units.LENGTH)}"
        raise UnitError(f"'{value}' is no {DETAIL.name}, check its unit; {ends} is expected")
    return window


PictureWindow = Annotated[
    Window,
    PlainValidator(_window),
    WithJsonSchema(
        {
            "type": "string",
            "description": "pixels, or a length on the object",
            "examples": ["9 px", "1 mm"],
            "pattern": r"^[+]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*[A-Za-zµμÅ].*$",
        }
    ),
]
FieldAngle = Annotated[float, *quantity(units.ANGLE, at_least=0.0, at_most=89.0 * units.DEGREE)]
LinearFillFactor = Annotated[float, *quantity(units.FRACTION, above=0.0, at_most=1.0)]


class TexturePart(Part):
    """The surface: a random texture whose autocorrelation falls off exponentially."""

    contrast: PositiveFraction = Field(description="Standard deviation of the radiance over its mean.")
    correlation_length: DetailSize = Field(
        description="On the object: where the autocorrelation of the radiance is down to 1/e."
    )


class LightPart(Part):
    """Scene and exposure, the same for all cameras."""

    electrons: PositiveElectrons | None = Field(
        default=None, description="Mean electrons of a pixel at that f-number, on the axis."
    )
    photons: PositivePhotons | None = Field(
        default=None,
        description="Instead: mean photons on a pixel, of which each sensor's quantum_efficiency makes electrons.",
    )
    at_f_number: FNumber = Field(description="Working f-number: image distance over pupil diameter.")
    at_pixel_pitch: PixelPitch | None = Field(
        default=None, description="Of such a pixel; left out, every pixel collects that, whatever its size."
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.electrons is None) == (self.photons is None):
            raise MistakeAt((), "give exactly one of electrons and photons (null takes an inherited one back)")
        return self

    def light(self, sensor: Sensor | None) -> Light:
        """In SI, as a sensor collects it: ``μ_e = η μ_p``, or the electrons that are given.

        Raises
        ------
        OutOfRangeError
            For photons on a sensor without a quantum efficiency.
        """
        electrons = self.electrons
        if electrons is None:
            assert self.photons is not None  # one of the two is given
            if sensor is None or sensor.quantum_efficiency is None:
                raise OutOfRangeError(
                    "light in photons falls on a sensor without a quantum efficiency",
                    value=pretty(self.photons, units.PHOTONS),
                    remedy="give sensor.quantum_efficiency, or scene.picture.light.electrons",
                )
            electrons = self.photons * sensor.quantum_efficiency
        return Light(electrons=electrons, f_number=self.at_f_number, pixel_pitch=self.at_pixel_pitch)


class SpectralLinePart(Part):
    """A wavelength and its weight."""

    wavelength: PositiveWavelength = Field(description="Wavelength of this line.")
    weight: PositiveNumber = Field(description="Share of the light in this line, relative to the others.")


class PicturePart(Part):
    """What a derived disparity error follows from, the same for every camera that has one."""

    texture: TexturePart
    matching_window: PictureWindow = Field(
        description="Side of the square that is matched: pixels, or a length on the object. At most what the "
        "compared pictures share: of two micro-images less the farther apart their lenses are."
    )
    matcher: MatcherPart | None = Field(
        default=None,
        description="What a real matcher adds to the bound. A camera's own depth.matcher counts before it, key by key; "
        "without either, a derived error is the best that any matcher can reach.",
    )
    light: LightPart
    read_noise: NonNegativeElectrons = Field(
        description="Standard deviation of one reading of a pixel; a sensor's own temporal_dark_noise counts before it."
    )
    full_well: PositiveElectrons = Field(
        description="Where a pixel saturates, and the top of the digitised scale; a sensor's own saturation_capacity "
        "and system_gain count before it."
    )
    bit_depth: Annotated[int, Field(strict=True, ge=1, le=32)] = Field(description="Of a raw value.")
    field_angle: FieldAngle = Field(
        default=0.0,
        description="Of the place in the picture whose light counts for depth on the axis; needs the vignetting there. "
        "Each of propagation.field_places has its own.",
    )
    stop_separation: NonNegativeLength = Field(
        default=0.0, description="Of two equal round stops that cut the pupil away from the axis; 0 m: none does."
    )
    linear_fill_factor: LinearFillFactor = Field(default=1.0, description="Active width of a pixel over its pitch.")
    spectrum: Annotated[tuple[SpectralLinePart, ...], Field(min_length=1, max_length=100)] | None = Field(
        default=None, description="Wavelengths with weights; default: the wavelength of the scene."
    )
    lens_phase: Literal["perfect", "parabolic"] = Field(
        default="perfect",
        description="Lens of the Kirchhoff model: well corrected, or the parabolic phase of the paper.",
    )

    def noise(self, sensor: Sensor | None) -> SensorNoise:
        """In SI; what a sensor declares of itself counts before what the scene does."""
        noise = SensorNoise(
            read_noise_electrons=self.read_noise, full_well_electrons=self.full_well, bits=self.bit_depth
        )
        if sensor is None:
            return noise
        dark, well = sensor.temporal_dark_noise, sensor.saturation_capacity
        return replace(
            noise,
            read_noise_electrons=self.read_noise if dark is None else dark,
            full_well_electrons=self.full_well if well is None else well,
            gain=sensor.system_gain,
        )

    def settings(self, wavelength: float, sensor: Sensor | None = None) -> PictureSettings:
        """Texture, light, sensor and window in SI.

        Parameters
        ----------
        wavelength
            The central one [m].
        sensor
            That of the camera, whose own values count before those of the scene; None: those of the scene alone.

        Raises
        ------
        OutOfRangeError
            For light in photons on a sensor without a quantum efficiency.
        """
        texture, window = self.texture, self.matching_window
        return PictureSettings(
            texture=Texture(contrast=texture.contrast, correlation_length=texture.correlation_length),
            light=self.light.light(sensor),
            sensor_noise=self.noise(sensor),
            wavelength=wavelength,
            window_px=window.size if window.of == "picture" else None,
            window_length=window.size if window.of == "object" else None,
            spectrum=tuple((line.wavelength, line.weight) for line in self.spectrum or ()),
            field_angle=self.field_angle,
            stop_separation=self.stop_separation,
            pixel_fill=self.linear_fill_factor,
            lens_phase=self.lens_phase,
        )
