"""The scene: its distances, texture, light and surfaces, and how pictures of them are taken and measured."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Annotated, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from pydantic import AfterValidator, Field, PlainValidator, WithJsonSchema, model_validator

from tradestudy import units
from tradestudy.cameras.parts import Sensor
from tradestudy.declarations.matcher import MatcherPart
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    DETAIL,
    DetailSize,
    FNumber,
    Length,
    NonNegativeElectrons,
    NonNegativeLength,
    ObjectDistance,
    PixelPitch,
    PositiveAngle,
    PositiveElectrons,
    PositiveFraction,
    PositiveNumber,
    PositivePhotons,
    PositiveWavelength,
    Share,
    distinct,
    quantity,
)
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.models import Light, PictureSettings, SensorNoise, SensorNoiseModel, Texture
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


MOST_DISTANCES = 100_000


class DistanceRangePart(Part):
    """A range of distances with logarithmic or linear spacing."""

    increasing = ("start", "stop")

    start: ObjectDistance = Field(alias="from", description="Nearest distance.")
    stop: ObjectDistance = Field(alias="to", description="Farthest distance.")
    points: Annotated[int, Field(ge=2, le=MOST_DISTANCES, strict=True)] = Field(
        description="Number of distances, including both ends."
    )
    spacing: Literal["log", "linear"] = Field(
        default="log", description="Spacing of the distances: equal ratios (log) or equal differences (linear)."
    )

    def values(self) -> tuple[float, ...]:
        """The distances [m]; the ends are exactly as declared."""
        space = np.geomspace if self.spacing == "log" else np.linspace
        return tuple(float(value) for value in space(self.start, self.stop, self.points))


Tilt = Annotated[float, *quantity(units.ANGLE, at_least=-80.0 * DEGREE, at_most=80.0 * DEGREE)]
Place = tuple[Length, Length]
FileName = Annotated[str, Field(min_length=1, max_length=1000)]
MOST_STEPS = 50
MOST_SURFACES = 20


Rig = Literal["as-designed", "drawn"]


class PlanePart(Part):
    """A textured plane, perpendicular to the optical axis or tilted."""

    shape: Literal["plane"]
    distance: ObjectDistance = Field(description="Distance of the centre, along the optical axis.")
    centre: Place = Field(
        default=(0.0, 0.0), description="Offsets of the centre from the optical axis, to the right and downwards."
    )
    size: tuple[DetailSize, DetailSize] | None = Field(
        default=None, description="Width and height of the plane; default: infinite."
    )
    tilt_x: Tilt = Field(
        default=0.0, description="Tilt of the plane along x; above 0°, its right side is farther away."
    )
    tilt_y: Tilt = Field(default=0.0, description="Tilt of the plane along y; above 0°, its bottom is farther away.")


class StairsPart(Part):
    """Treads that face the camera, from near (left) to far (right), joined by risers.

    A `step` has two treads, a `staircase` three or more.
    """

    increasing = ("near", "far")

    shape: Literal["step", "staircase"]
    near: ObjectDistance = Field(description="Distance of the nearest tread.")
    far: ObjectDistance = Field(description="Distance of the farthest tread.")
    treads: Annotated[int, Field(strict=True, ge=2, le=MOST_STEPS)] = Field(
        default=2,
        description="Number of treads. A step has 2, the default; a staircase needs this key, with 3 or more.",
    )
    tread_width: DetailSize | None = Field(
        default=None,
        description="Width of each tread of a staircase, except the first and the last, which are infinitely wide; "
        "required for a staircase, and not accepted for a step.",
    )
    edge: Length = Field(
        default=0.0,
        description="Offset of the riser of a step, or of the middle of a staircase, to the right of the optical axis.",
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if self.shape == "step" and (self.treads != 2 or self.tread_width is not None):
            yield MistakeAt((), "a step has two treads without a width; use shape: staircase")
        if self.shape == "staircase" and self.tread_width is None:
            yield MistakeAt((), "a staircase needs a tread_width")
        if self.shape == "staircase" and self.treads == 2:
            yield MistakeAt((), "a staircase of two treads, both infinitely wide, is a step; give treads: 3 or more")


class SpherePart(Part):
    """A textured sphere."""

    shape: Literal["sphere"]
    distance: ObjectDistance = Field(description="Distance of the centre, along the optical axis.")
    centre: Place = Field(
        default=(0.0, 0.0), description="Offsets of the centre from the optical axis, to the right and downwards."
    )
    radius: DetailSize = Field(description="Radius of the sphere.")

    def _mistakes(self) -> Iterator[MistakeAt]:
        if not self.radius < self.distance:
            yield MistakeAt(("radius",), "puts the camera inside the sphere; less than its distance is expected")


class RockPart(Part):
    """A rough surface made of random noise; it repeats itself after 32 times `feature_size`."""

    increasing = ("near", "far")

    shape: Literal["rock"]
    near: ObjectDistance = Field(description="Distance of the nearest point of the rock.")
    far: ObjectDistance = Field(description="Distance of the farthest point of the rock.")
    feature_size: DetailSize = Field(
        description="Size of the largest features of the surface; the heights of smaller ones follow a power law."
    )
    hurst: Share = Field(
        default=0.8, description="Hurst exponent of the power law, from rugged (0 %) to smooth (100 %)."
    )


class DepthMapPart(Part):
    """A surface from a depth map (PNG, PGM, PFM, TIFF or NPY), with a picture or the scene's texture on it."""

    exactly_one = (("width", "field_of_view"),)

    shape: Literal["depth-map"]
    depth: FileName = Field(
        description="File of the depth map, which gives the distance along the optical axis at every pixel; no value "
        "may be missing."
    )
    unit: DetailSize = Field(description="Distance that a value of 1 in the depth map stands for.")
    first_row: Literal["top", "bottom"] = Field(
        description="Side of the scene that the first row of the depth map shows. The first row of a PFM file is the "
        "one that viewers show at the top, although it is stored last."
    )
    width: DetailSize | None = Field(
        default=None,
        description="Width of the part of the scene that the depth map shows, if its lines of sight are parallel.",
    )
    field_of_view: PositiveAngle | None = Field(
        default=None,
        description="Instead of `width`: horizontal field of view of the depth map, if its lines of sight meet at "
        "one point. That point is the main lens or, for a stereo rig, the middle of the baseline.",
    )
    picture: FileName | None = Field(
        default=None,
        description="Image file of the brightness of the surface, grey or in colour. Its values are proportional to "
        "brightness, and its rows are in the order of the depth map. Default: the texture of scene.picture.",
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if self.field_of_view is not None and self.field_of_view >= 179.0 * DEGREE:
            yield MistakeAt(("field_of_view",), "an angle below 179 deg is expected")


SurfacePart = Annotated[
    PlanePart | StairsPart | SpherePart | RockPart | DepthMapPart,
    Field(discriminator="shape"),
]


class MosaicPart(Part):
    """A Bayer mosaic in front of the pixels."""

    pattern: Literal["RGGB", "BGGR", "GRBG", "GBRG"] = Field(
        description="Colours of the first two pixels of the first row, then of the second row."
    )
    response: tuple[PositiveFraction, PositiveFraction, PositiveFraction] = Field(
        description="Electrons in a red, a green and a blue pixel, each relative to those in a pixel without a filter."
    )


class SceneImagePart(Part):
    """Surfaces, and how `python -m tradestudy render` makes pictures of them.

    Texture, light, the noise of the sensor, fill factor and stop separation are those of scene.picture; the key `noise`
    chooses which kinds of noise the pictures have. The other keys of scene.picture (window, matcher, field angle,
    spectrum and lens phase) do not change the pictures. A picture shows the camera's whole field of view.

    The program renders pictures with rays. If diffraction would change a picture by more than accuracy.pixel_intensity,
    the program also computes the diffraction at all lenses by wave optics, for the wavelength scene.wavelength. The
    keys main_lens_diffraction and microlens_diffraction of `effects` can prescribe the choice: `fresnel` prescribes
    diffraction, `off` prescribes rays. In pictures of a camera with microlenses, all lenses are treated alike, so
    either key decides for all of them; if the two contradict each other, the study is refused. For any other camera,
    only main_lens_diffraction counts. If one of these keys prescribes any other model, such as `airy`, pictures are
    rendered as if that key were absent.
    """

    surfaces: Annotated[tuple[SurfacePart, ...], Field(min_length=1, max_length=MOST_SURFACES)] = Field(
        description="Surfaces in the scene; the nearest hides those behind it."
    )
    background: Share = Field(
        default=0.0, description="Brightness where there is no surface, relative to the mean brightness of the texture."
    )
    cameras: Annotated[tuple[str, ...], Field(min_length=1)] | None = Field(
        default=None, description="Cameras that take pictures; default: all."
    )
    rig: Rig = Field(
        default="as-designed",
        description="Whether the cameras that take the pictures have no errors (`as-designed`), or errors that are "
        "drawn once from their calibrations (`drawn`).",
    )
    noise: SensorNoiseModel = Field(
        default="shot+read+quantisation",
        description="Noise in the pictures: none (`off`); the shot noise of the light (`shot`); this and the read "
        "noise (`shot+read`); or these and the rounding to raw values (`shot+read+quantisation`). Pictures with "
        "quantisation are 16-bit PNG files of raw values; others are floating-point TIFF files of electrons.",
    )
    black_level: NonNegativeElectrons = Field(
        default=0.0,
        description="Constant number of electrons that is added to every pixel before the signal is digitised.",
    )
    mosaic: MosaicPart | None = Field(default=None, description="Colour filters in front of the pixels; default: none.")
    samples: Annotated[int, Field(strict=True, ge=4, le=4096)] | None = Field(
        default=None,
        description="Number of rays traced from each pixel through each lens or microlens that sends light to this "
        "pixel. The file camera.json beside the pictures states the resulting error. Default: 12 for unfocused "
        "plenoptic cameras, 8 for others.",
    )
    depth_maps: bool = Field(
        default=False,
        strict=True,
        description="Whether the command `run` also measures depth in the pictures and compares it with the true "
        "depth (for `render`, its option `--depth` decides this). Must be `false` if `mosaic` is given.",
    )
    depth_format: Literal["tiff", "npy"] = Field(
        default="tiff", description="Format of the files with the true depth in metres."
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if self.depth_maps and self.mosaic is not None:
            yield MistakeAt(
                ("depth_maps",),
                "depth cannot be measured in pictures taken through a mosaic of colour filters; remove mosaic, or set "
                "depth_maps: false",
            )

    def files(self) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """The files named in this part, each with the path of its name."""
        for number, surface in enumerate(self.surfaces):
            if isinstance(surface, DepthMapPart):
                yield ("surfaces", number, "depth"), surface.depth
                if surface.picture is not None:
                    yield ("surfaces", number, "picture"), surface.picture


_MOST = 50


class DepthLoopPart(Part):
    """A comparison of predicted depth uncertainties with the depth errors in rendered pictures of planes.

    The planes are perpendicular to the optical axis. Texture, light, noise and window are those of scene.picture. The
    program fits the parameters of the matcher to the depth errors at the distances in `fitted_at`. It tests the fitted
    matcher at all other distances, with other random textures and noise.
    """

    distances: Annotated[tuple[ObjectDistance, ...], Field(min_length=2, max_length=_MOST)] = Field(
        description="Distances of the planes, in increasing order."
    )
    fitted_at: Annotated[
        tuple[ObjectDistance, ...], Field(min_length=1, max_length=_MOST), AfterValidator(distinct)
    ] = Field(description="Those of the `distances` at which the matcher is fitted to the depth errors.")
    cameras: Annotated[tuple[str, ...], Field(min_length=1), AfterValidator(distinct)] | None = Field(
        default=None, description="Cameras to test; default: all that measure depth."
    )
    contrasts: (
        Annotated[tuple[PositiveFraction, ...], Field(min_length=1, max_length=_MOST), AfterValidator(distinct)] | None
    ) = Field(
        default=None, description="Contrasts of the texture to test; default: the contrast in scene.picture.texture."
    )
    electrons: (
        Annotated[tuple[PositiveElectrons, ...], Field(min_length=1, max_length=_MOST), AfterValidator(distinct)] | None
    ) = Field(
        default=None,
        description="Mean numbers of electrons per pixel to test; default: scene.picture.light.electrons. Needed if "
        "the light is given in photons.",
    )
    texture_scaled_from: ObjectDistance | None = Field(
        default=None,
        description="Distance at which the texture has its declared correlation length. At other distances, that "
        "length is proportional to the distance, so that a camera sees the same texture everywhere. "
        "Default: no scaling.",
    )
    windows: Annotated[int, Field(strict=True, ge=100, le=1_000_000)] = Field(
        default=1500,
        description="Number of non-overlapping matching windows to measure on each plane, in at most eight pictures. "
        "The spread of the depth errors is then known with a relative error of about 1/√windows.",
    )
    samples: Annotated[int, Field(strict=True, ge=4, le=4096)] = Field(
        default=64,
        description="Number of rays traced from each pixel through each lens or microlens that sends light to this "
        "pixel. With too few, the noise of rendering looks like an error of the matcher.",
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if wrong := [k for k, (near, far) in enumerate(itertools.pairwise(self.distances), start=1) if not near < far]:
            yield MistakeAt(("distances", wrong[0]), "distances must increase, without repeats")
        if unknown := [k for k, distance in enumerate(self.fitted_at) if distance not in self.distances]:
            yield MistakeAt(("fitted_at", unknown[0]), "is not one of the distances")


class ScenePart(Part):
    """The scene that the cameras observe."""

    distances: (
        DistanceRangePart | Annotated[tuple[ObjectDistance, ...], Field(min_length=2, max_length=MOST_DISTANCES)]
    ) = Field(description="Distances at which the cameras are evaluated: a range or an increasing list.")
    wavelength: PositiveWavelength = Field(description="Wavelength of the light.")
    picture: PicturePart | None = Field(
        default=None,
        description="Texture, light and sensor noise, from which the program derives disparity errors and renders "
        "pictures.",
    )

    image: SceneImagePart | None = Field(
        default=None,
        description="Surfaces at different depths, of which the commands `run` and `render` make pictures.",
    )

    @model_validator(mode="after")
    def _image_needs_light(self) -> Self:
        if self.image is not None and self.picture is None:
            raise MistakeAt(("image",), "needs scene.picture too, which gives its texture, light and noise")
        return self

    @model_validator(mode="after")
    def _sorted(self) -> Self:
        pairs = enumerate(itertools.pairwise(self.distance_values()), start=1)
        if wrong := [index for index, (near, far) in pairs if not near < far]:
            tail = () if isinstance(self.distances, DistanceRangePart) else (wrong[0],)
            raise MistakeAt(("distances", *tail), "distances must increase, without repeats")
        return self

    def distance_values(self) -> tuple[float, ...]:
        """The distances [m], increasing."""
        return self.distances.values() if isinstance(self.distances, DistanceRangePart) else self.distances
