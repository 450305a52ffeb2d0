"""What a camera's picture of the scene is made of: texture, light, sensor, and the window that is matched."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, PlainValidator, WithJsonSchema

from tradestudy import units
from tradestudy.declarations.matcher import MatcherPart
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
    PositiveWavelength,
    quantity,
)
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

    electrons: PositiveElectrons = Field(description="Mean electrons of a pixel at that f-number, on the axis.")
    at_f_number: FNumber = Field(description="Working f-number: image distance over pupil diameter.")
    at_pixel_pitch: PixelPitch | None = Field(
        default=None, description="Of such a pixel; left out, every pixel collects that, whatever its size."
    )


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
    read_noise: NonNegativeElectrons = Field(description="Standard deviation of one reading of a pixel.")
    full_well: PositiveElectrons = Field(description="Where a pixel saturates, and the top of the digitised scale.")
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

    def settings(self, wavelength: float) -> PictureSettings:
        """Texture, light, sensor and window in SI; ``wavelength`` [m] is the central one."""
        texture, light, window = self.texture, self.light, self.matching_window
        return PictureSettings(
            texture=Texture(contrast=texture.contrast, correlation_length=texture.correlation_length),
            light=Light(electrons=light.electrons, f_number=light.at_f_number, pixel_pitch=light.at_pixel_pitch),
            sensor_noise=SensorNoise(
                read_noise_electrons=self.read_noise, full_well_electrons=self.full_well, bits=self.bit_depth
            ),
            wavelength=wavelength,
            window_px=window.size if window.of == "picture" else None,
            window_length=window.size if window.of == "object" else None,
            spectrum=tuple((line.wavelength, line.weight) for line in self.spectrum or ()),
            field_angle=self.field_angle,
            stop_separation=self.stop_separation,
            pixel_fill=self.linear_fill_factor,
            lens_phase=self.lens_phase,
        )
