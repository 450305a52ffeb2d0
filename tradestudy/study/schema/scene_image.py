"""The scene for rendered pictures: surfaces with depth, and how pictures of them are taken."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tradestudy import units
from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.part import Part
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
from tradestudy.imaging.light import SensorNoiseModel

Tilt = Annotated[float, *quantity(units.ANGLE, at_least=-80.0 * units.DEGREE, at_most=80.0 * units.DEGREE)]
Place = tuple[Length, Length]
FileName = Annotated[str, Field(min_length=1, max_length=1000)]
MOST_STEPS = 50
MOST_SURFACES = 20


Rig = Literal["as-designed", "drawn"]


class PlanePart(Part):
    """A textured plane, upright or slanted."""

    shape: Literal["plane"]
    distance: ObjectDistance = Field(description="Distance of its centre along the axis.")
    centre: Place = Field(default=(0.0, 0.0), description="Offsets to the right of the axis and below it.")
    size: tuple[DetailSize, DetailSize] | None = Field(default=None, description="Width and height; default: infinite.")
    tilt_x: Tilt = Field(default=0.0, description="Slope along x; above 0°, the right is farther away.")
    tilt_y: Tilt = Field(default=0.0, description="Slope along y; above 0°, the bottom is farther away.")


class StairsPart(Part):
    """Upright treads from near (left) to far (right), with risers between them; two treads make a step."""

    shape: Literal["step", "staircase"]
    near: ObjectDistance = Field(description="Distance of the nearest tread.")
    far: ObjectDistance = Field(description="Distance of the farthest tread.")
    treads: Annotated[int, Field(strict=True, ge=2, le=MOST_STEPS)] = Field(default=2, description="Number of treads.")
    tread_width: DetailSize | None = Field(
        default=None,
        description="Width of each tread except the first and the last, which are infinitely wide; not for a step.",
    )
    edge: Length = Field(default=0.0, description="Position of the middle of all edges, to the right of the axis.")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.near < self.far:
            raise MistakeAt(("far",), "must lie beyond near")
        if self.shape == "step" and (self.treads != 2 or self.tread_width is not None):
            raise MistakeAt((), "a step has two treads without a width; use shape: staircase")
        if self.shape == "staircase" and self.tread_width is None:
            raise MistakeAt((), "a staircase needs a tread_width")
        return self


class SpherePart(Part):
    """A textured sphere."""

    shape: Literal["sphere"]
    distance: ObjectDistance = Field(description="Distance of its centre along the axis.")
    centre: Place = Field(default=(0.0, 0.0), description="Offsets to the right of the axis and below it.")
    radius: DetailSize = Field(description="Radius of the sphere.")

    @model_validator(mode="after")
    def _before_the_camera(self) -> Self:
        if not self.radius < self.distance:
            raise MistakeAt(("radius",), "puts the camera inside the sphere; less than its distance is expected")
        return self


class RockPart(Part):
    """A rough surface of seeded noise, which repeats after 32 features."""

    shape: Literal["rock"]
    near: ObjectDistance = Field(description="Distance of its nearest point.")
    far: ObjectDistance = Field(description="Distance of its farthest point.")
    feature_size: DetailSize = Field(description="Size of its largest features; smaller ones follow a power law.")
    hurst: Share = Field(default=0.8, description="Hurst exponent: 1 is smooth, 0 is rugged.")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.near < self.far:
            raise MistakeAt(("far",), "must lie beyond near")
        return self


class DepthMapPart(Part):
    """A surface from a depth map (8- or 16-bit PNG, TIFF or NPY), with a picture or the scene's texture on it."""

    shape: Literal["depth-map"]
    depth: FileName = Field(description="File of the map: distances along the axis, without holes.")
    unit: DetailSize = Field(description="Distance per unit of its values, such as 1 mm.")
    first_row: Literal["top", "bottom"] = Field(description="Side of the scene that its first row shows.")
    width: DetailSize | None = Field(default=None, description="Width of the whole map, seen along parallel lines.")
    field_of_view: PositiveAngle | None = Field(
        default=None,
        description="Instead of width: field of view across the whole map, seen from the origin as by a pinhole.",
    )
    picture: FileName | None = Field(
        default=None,
        description="Image file of its brightness, grey or in colour, with linear values and rows in the same order.",
    )

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.width is None) == (self.field_of_view is None):
            raise MistakeAt((), "give exactly one of width and field_of_view")
        if self.field_of_view is not None and self.field_of_view >= 179.0 * units.DEGREE:
            raise MistakeAt(("field_of_view",), "an angle below 179 deg is expected")
        return self


SurfacePart = Annotated[
    PlanePart | StairsPart | SpherePart | RockPart | DepthMapPart,
    Field(discriminator="shape"),
]


class MosaicPart(Part):
    """A Bayer mosaic in front of the pixels."""

    pattern: Literal["RGGB", "BGGR", "GRBG", "GBRG"] = Field(
        description="Colours of the first two pixels of rows one and two."
    )
    response: tuple[PositiveFraction, PositiveFraction, PositiveFraction] = Field(
        description="Electrons of red, green and blue pixels, relative to pixels without a filter."
    )


class SceneImagePart(Part):
    """Surfaces, and how `render` makes pictures of them.

    Texture, light, noise, fill factor and stops are those of scene.picture; its other keys (window, matcher, field
    angle, spectrum and lens phase) do not change the pictures. Pictures show the whole field. They are rendered by
    rays, or by waves of the scene's wavelength where diffraction matters or where effects force it
    (main_lens_diffraction, microlens_diffraction: fresnel).
    """

    surfaces: Annotated[tuple[SurfacePart, ...], Field(min_length=1, max_length=MOST_SURFACES)] = Field(
        description="Surfaces in the scene; the nearest hides those behind it."
    )
    background: Share = Field(
        default=0.0, description="Brightness where there is no surface, relative to the mean of the texture."
    )
    cameras: Annotated[tuple[str, ...], Field(min_length=1)] | None = Field(
        default=None, description="Cameras that take pictures; default: all."
    )
    rig: Rig = Field(
        default="as-designed",
        description="as-designed: without errors; drawn: with errors drawn once from the calibration of each camera.",
    )
    noise: SensorNoiseModel = Field(
        default="shot+read+quantisation",
        description="Noise of the pictures; quantised pictures are 16-bit PNG files in digital numbers, others are "
        "floating-point TIFF files in electrons.",
    )
    black_level: NonNegativeElectrons = Field(default=0.0, description="Electrons added before digitising.")
    mosaic: MosaicPart | None = Field(default=None, description="Colour filters; default: none.")
    samples: Annotated[int, Field(strict=True, ge=4, le=4096)] | None = Field(
        default=None,
        description="Rays per pixel and lens, half as many where a lens is barely lit; camera.json states the "
        "resulting error. Default: 12 for unfocused plenoptic cameras, 8 for others.",
    )
    depth_maps: bool = Field(
        default=False,
        strict=True,
        description="Whether a run also measures depth in the pictures and compares it with the true depth.",
    )
    depth_format: Literal["tiff", "npy"] = Field(
        default="tiff", description="File format of the true depth, in metres."
    )

    def files(self) -> Iterator[tuple[tuple[str | int, ...], str]]:
        """The files named in this part, each with the path of its name."""
        for number, one in enumerate(self.surfaces):
            if isinstance(one, DepthMapPart):
                yield ("surfaces", number, "depth"), one.depth
                if one.picture is not None:
                    yield ("surfaces", number, "picture"), one.picture
