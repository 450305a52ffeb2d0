"""The scene for rendered pictures: surfaces with depth, and how pictures of them are taken."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tradestudy import units
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import (
    DetailSize,
    Length,
    NonNegativeElectrons,
    ObjectDistance,
    PositiveAngle,
    PositiveFraction,
    Share,
    quantity,
)
from tradestudy.imaging.models import SensorNoiseModel
from tradestudy.unit_registry import DEGREE

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

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.near < self.far:
            raise MistakeAt(("far",), "must lie beyond near")
        if self.shape == "step" and (self.treads != 2 or self.tread_width is not None):
            raise MistakeAt((), "a step has two treads without a width; use shape: staircase")
        if self.shape == "staircase" and self.tread_width is None:
            raise MistakeAt((), "a staircase needs a tread_width")
        if self.shape == "staircase" and self.treads == 2:
            raise MistakeAt((), "a staircase of two treads, both infinitely wide, is a step; give treads: 3 or more")
        return self


class SpherePart(Part):
    """A textured sphere."""

    shape: Literal["sphere"]
    distance: ObjectDistance = Field(description="Distance of the centre, along the optical axis.")
    centre: Place = Field(
        default=(0.0, 0.0), description="Offsets of the centre from the optical axis, to the right and downwards."
    )
    radius: DetailSize = Field(description="Radius of the sphere.")

    @model_validator(mode="after")
    def _before_the_camera(self) -> Self:
        if not self.radius < self.distance:
            raise MistakeAt(("radius",), "puts the camera inside the sphere; less than its distance is expected")
        return self


class RockPart(Part):
    """A rough surface made of random noise; it repeats itself after 32 times `feature_size`."""

    shape: Literal["rock"]
    near: ObjectDistance = Field(description="Distance of the nearest point of the rock.")
    far: ObjectDistance = Field(description="Distance of the farthest point of the rock.")
    feature_size: DetailSize = Field(
        description="Size of the largest features of the surface; the heights of smaller ones follow a power law."
    )
    hurst: Share = Field(
        default=0.8, description="Hurst exponent of the power law, from rugged (0 %) to smooth (100 %)."
    )

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.near < self.far:
            raise MistakeAt(("far",), "must lie beyond near")
        return self


class DepthMapPart(Part):
    """A surface from a depth map (PNG of 8 or 16 bits, TIFF or NPY), with a picture or the scene's texture on it."""

    shape: Literal["depth-map"]
    depth: FileName = Field(
        description="File of the depth map, which gives the distance along the optical axis at every pixel; no value "
        "may be missing."
    )
    unit: DetailSize = Field(description="Distance that a value of 1 in the depth map stands for.")
    first_row: Literal["top", "bottom"] = Field(
        description="Side of the scene that the first row of the depth map shows."
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

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.width is None) == (self.field_of_view is None):
            raise MistakeAt((), "give exactly one of width and field_of_view")
        if self.field_of_view is not None and self.field_of_view >= 179.0 * DEGREE:
            raise MistakeAt(("field_of_view",), "an angle below 179 deg is expected")
        return self


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

    @model_validator(mode="after")
    def _depth_without_mosaic(self) -> Self:
        if self.depth_maps and self.mosaic is not None:
            raise MistakeAt(
                ("depth_maps",),
                "depth cannot be measured in pictures taken through a mosaic of colour filters; remove mosaic, or set "
                "depth_maps: false",
            )
        return self

    def files(self) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """The files named in this part, each with the path of its name."""
        for number, one in enumerate(self.surfaces):
            if isinstance(one, DepthMapPart):
                yield ("surfaces", number, "depth"), one.depth
                if one.picture is not None:
                    yield ("surfaces", number, "picture"), one.picture
