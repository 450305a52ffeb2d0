"""What determines a camera's picture of the scene: texture, light, sensor, and the matching window."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal, NamedTuple

from pydantic import Field, PlainValidator, WithJsonSchema

from tradestudy import units
from tradestudy.cameras.parts import Sensor
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
    PositivePhotons,
    PositiveWavelength,
    quantity,
)
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.models import Light, PictureSettings, SensorNoise, Texture
from tradestudy.unit_registry import DEGREE
from tradestudy.units import UnitError, parse, pretty


class Window(NamedTuple):
    """Side of the matching window, in pixels of the picture or as a length on the object [m]."""

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
                f"{shown} is not a window; a number of pixels such as 9 px, or a length on the object such as 1 mm, is "
                "expected"
            ) from None
    if not 0.0 < window.size < float("inf"):
        raise UnitError(f"'{value}' is out of range; a window above 0 px or 0 m is expected")
    if window.of == "object" and not DETAIL.smallest <= window.size <= DETAIL.largest:
        ends = f"{pretty(DETAIL.smallest, units.LENGTH)} to {pretty(DETAIL.largest, units.LENGTH)}"
        raise UnitError(f"'{value}' is not a plausible {DETAIL.name}; check its unit; {ends} is expected")
    return window


PictureWindow = Annotated[
    Window,
    PlainValidator(_window),
    WithJsonSchema(
        {
            "type": "string",
            "title": "a number of pixels, or a length on the object",
            "examples": ["9 px", "1 mm"],
            "pattern": r"^[+]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*[A-Za-zµμÅ].*$",
        }
    ),
]
FieldAngle = Annotated[float, *quantity(units.ANGLE, at_least=0.0, at_most=89.0 * DEGREE)]
LinearFillFactor = Annotated[float, *quantity(units.FRACTION, above=0.0, at_most=1.0)]


class TexturePart(Part):
    """The texture of the surfaces: random, with an autocorrelation that falls off exponentially."""

    contrast: PositiveFraction = Field(description="Standard deviation of the radiance, relative to its mean.")
    correlation_length: DetailSize = Field(
        description="Length on the object at which the autocorrelation of the radiance falls to 1/e."
    )


class LightPart(Part):
    """The light that a pixel collects during an exposure."""

    absent: ClassVar[Mapping[str, str]] = {"at_pixel_pitch": "every pixel collects this light, whatever its size"}
    exactly_one = (("electrons", "photons"),)

    electrons: PositiveElectrons | None = Field(
        default=None, description="Mean number of electrons that a pixel on the optical axis collects."
    )
    photons: PositivePhotons | None = Field(
        default=None,
        description="Instead of `electrons`: mean number of photons that reach a pixel on the optical axis; the "
        "quantum_efficiency of each sensor converts them to electrons.",
    )
    at_f_number: FNumber = Field(
        description="Working f-number (image distance over pupil diameter) at which a pixel collects this light. At "
        "any other f-number, the light is inversely proportional to the square of the f-number."
    )
    at_pixel_pitch: PixelPitch | None = Field(
        default=None,
        description="Pixel pitch at which a pixel collects this light. At other pitches, the light is proportional to "
        "the area of the pixel. Default: every pixel collects this light, whatever its size.",
    )

    def light(self, sensor: Sensor | None) -> Light:
        """The light that a sensor collects, in SI: ``μ_e = η μ_p``, or the declared electrons.

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
                    "light is given in photons, but the sensor has no quantum efficiency",
                    value=pretty(self.photons, units.PHOTONS),
                    remedy="give sensor.quantum_efficiency, or scene.picture.light.electrons",
                )
            electrons = self.photons * sensor.quantum_efficiency
        electrons *= 1.0 if sensor is None else sensor.relative_exposure
        return Light(electrons=electrons, f_number=self.at_f_number, pixel_pitch=self.at_pixel_pitch)


class SpectralLinePart(Part):
    """One wavelength of the light, and its weight."""

    wavelength: PositiveWavelength = Field(description="Wavelength of this line.")
    weight: PositiveNumber = Field(
        description="Number of electrons that this line contributes, relative to the other lines."
    )


class PicturePart(Part):
    """Inputs from which the program derives disparity errors and renders pictures.

    They apply to every camera; keys of a camera, such as `depth.matcher`, replace some of them.
    """

    absent: ClassVar[Mapping[str, str]] = {
        "matcher": "none: errors at the Cramér–Rao bound",
        "stop_separation": "no vignetting",
        "linear_fill_factor": "100 %",
        "spectrum": "scene.wavelength alone",
    }

    texture: TexturePart
    matching_window: PictureWindow = Field(
        description="Side of the square window in which two pictures are matched, in pixels or as a length on the "
        "object. Where the two pictures share only part of the window, only that part is matched."
    )
    matcher: MatcherPart | None = Field(
        default=None,
        description="Errors that a real matcher adds to the smallest possible disparity error (the Cramér–Rao "
        "bound); default: none. The keys of a camera's own depth.matcher override the keys given here one by one.",
    )
    light: LightPart
    read_noise: NonNegativeElectrons = Field(
        description="Standard deviation of the noise that is added when a pixel is read; the temporal_dark_noise of a "
        "sensor overrides it."
    )
    full_well: PositiveElectrons = Field(
        description="Number of electrons at which a pixel saturates; it maps to the largest raw value. The "
        "saturation_capacity of a sensor overrides the number, and its system_gain the mapping."
    )
    bit_depth: Annotated[int, Field(strict=True, ge=1, le=16)] = Field(
        description="Number of bits of a raw pixel value, up to the 16 that a PNG file can hold."
    )
    field_angle: FieldAngle = Field(
        default=0.0,
        description="Field angle at which vignetting is computed; at propagation.field_places, the angles of those "
        "positions apply instead.",
    )
    stop_separation: NonNegativeLength = Field(
        default=0.0,
        description="Distance between two equal round stops that vignette the pupil off the axis; at 0 m, they do "
        "not vignette.",
    )
    linear_fill_factor: LinearFillFactor = Field(
        default=1.0, description="Width of the light-sensitive area of a pixel, relative to the pixel pitch."
    )
    spectrum: Annotated[tuple[SpectralLinePart, ...], Field(min_length=1, max_length=100)] | None = Field(
        default=None, description="Wavelengths of the light with their weights; default: scene.wavelength alone."
    )
    lens_phase: Literal["perfect", "parabolic"] = Field(
        default="perfect",
        description="Phase of the lens when diffraction is computed by Kirchhoff's integral: that of a well-corrected "
        "lens (`perfect`), or the parabolic phase that Fresnel's approximation gives a thin lens (`parabolic`).",
    )

    def noise(self, sensor: Sensor | None) -> SensorNoise:
        """The noise in SI; values that the sensor declares override those of the scene."""
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
            The camera's sensor, whose own values override those of the scene; None: the scene's values alone.

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
