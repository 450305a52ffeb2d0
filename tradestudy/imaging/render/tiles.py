"""Pictures of one camera as built, rendered in independent tiles and recorded by its sensor."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.light_cones import Exposure
from tradestudy.cameras.parts import Sensor
from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.models import Light, SensorNoise, SensorNoiseModel, mean_electrons
from tradestudy.imaging.render.nodes import fewer, lit_area, nodes
from tradestudy.imaging.render.sight import sight
from tradestudy.imaging.render.waves import Waves
from tradestudy.imaging.scenes.pattern import GREY
from tradestudy.imaging.scenes.scene import SceneSource
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.sources import ErrorClass
from tradestudy.uncertainty.streams import point_generator

MosaicPattern = Literal["RGGB", "BGGR", "GRBG", "GBRG"]


@dataclass(frozen=True, kw_only=True)
class Mosaic:
    """A Bayer mosaic.

    Parameters
    ----------
    pattern
        Colours of the first two pixels of the first row, then of the second.
    response
        Electrons of red, green and blue pixels relative to a pixel without a filter.
    """

    pattern: MosaicPattern
    response: tuple[float, float, float]

    def colors(self, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> NDArray[np.intp]:
        """Colour of pixels: 0 red, 1 green, 2 blue."""
        numbers = np.array(["RGB".index(letter) for letter in self.pattern])
        return np.asarray(numbers[2 * (rows % 2) + columns % 2])


@dataclass(frozen=True, kw_only=True)
class Recording:
    """How the sensor records light.

    Parameters
    ----------
    light
        Light and exposure of the scene.
    noise
        Read noise, full well and bits.
    model
        Which noise terms to include; with quantisation the output is digital numbers, otherwise electrons.
    black_level
        Electrons added before digitising, so that noise in dark areas is not clipped.
    pixel_fill
        Width of the light-sensitive square relative to the pitch; the declared electrons of a pixel include it.
    mosaic
        Mosaic of colour filters, or None.

    Raises
    ------
    OutOfRangeError
        The black level is negative or not below the full well.
    """

    light: Light
    noise: SensorNoise
    model: SensorNoiseModel
    black_level: float = 0.0
    pixel_fill: float = 1.0
    mosaic: Mosaic | None = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.black_level < self.noise.full_well_electrons:
            raise OutOfRangeError(
                "black level",
                value=f"{self.black_level:g} e",
                limit=f"0 e to below the full well, {self.noise.full_well_electrons:g} e",
            )

    @property
    def saturation_electrons(self) -> float:
        """Mean electrons at which a pixel saturates: its full well, or fewer if digital numbers end earlier."""
        if not self.is_digital:
            return self.noise.full_well_electrons
        top = 2.0**self.noise.bits * self.noise.step_electrons - self.black_level
        return min(self.noise.full_well_electrons, top)

    @property
    def is_digital(self) -> bool:
        """Whether the output is digital numbers."""
        return self.model == "shot+read+quantisation"

    def electrons_at_f1(self, sensor: Sensor) -> float:
        """Mean electrons of a pixel at f/1 on the axis."""
        return float(mean_electrons(self.light, 1.0, sensor.pixel_pitch))

    def record(self, expected: FloatArray, rng: np.random.Generator) -> NDArray[Any]:
        """The output of pixels for expected electrons: float32 electrons, or unsigned digital numbers.

        A pixel holds at most its full well, which is also the top of the digitised range; the bottom is 0.
        """
        noise = self.noise
        electrons = expected if self.model == "off" else rng.poisson(expected).astype(float)
        electrons = np.minimum(electrons, noise.full_well_electrons)
        if "read" in self.model:
            electrons = electrons + rng.normal(0.0, noise.read_noise_electrons, expected.shape)
        if not self.is_digital:
            return np.asarray(electrons, np.float32)
        numbers = np.rint((electrons + self.black_level) / noise.step_electrons)
        kind = np.uint16 if noise.bits <= 16 else np.uint32
        return np.asarray(np.clip(numbers, 0, 2.0**noise.bits - 1), kind)


def drawn_errors(camera: DepthCamera, name: str, seed: int) -> dict[str, FloatArray]:
    """Draw the errors of a camera: a number for each parameter, or a pair for each element.

    Parameters
    ----------
    camera
        The camera with its calibration, whose parameters are those of the design.
    name
        Name of the camera, which selects its random numbers.
    seed
        Seed of the study.
    """
    calibration = camera.calibration
    values: dict[str, FloatArray] = {}
    for group in calibration.groups:
        rng = point_generator(seed=seed, point=f"rig {name}/{group.name}", replicate=0)
        elements = camera.elements if group.error_class is ErrorClass.ELEMENT else 0
        drawn = group.draw(rng.standard_normal((group.dimensions, 2 * elements or 1)))
        for parameter, row in zip(group.parameters, drawn, strict=True):
            values[parameter] = row.reshape(elements, 2) if elements else np.asarray(row[0])
    return calibration.errors(values)


TILE: Final = (256, 1024)
"""Rows and columns. Random numbers are drawn for each tile, so another size would change the noise."""
_AT_ONCE: Final = (64, 512)  # rows and columns whose rays fit into a processor's cache
_PROBE: Final = 24  # rows and columns in the middle of a tile that are compared with a finer picture
FINER: Final = 16
"""Factor on the number of samples in the finer picture, from which the error is estimated."""
_DIM: Final = 0.3  # lit fraction of a lens below which half of the samples suffice
WORKER_BYTES: Final = 400_000_000
"""Memory of one worker: interpreter, libraries, and the rays computed at once."""


@dataclass(frozen=True, kw_only=True)
class Tile:
    """A part of a picture to be rendered.

    Parameters
    ----------
    camera
        Name of the camera; with the name of the picture and the place of the tile, it selects the random numbers.
    exposure, scene, recording
        How the picture is taken, the scene, and how the sensor records it.
    samples
        Rays per pixel and lens.
    seed
        Seed of the study.
    rows, columns
        First, and one past the last.
    waves
        How diffraction bends light; None: rays alone.
    """

    camera: str
    exposure: Exposure
    scene: SceneSource
    recording: Recording
    samples: int
    seed: int
    rows: tuple[int, int]
    columns: tuple[int, int]
    waves: Waves | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Recorded:
    """What the sensor records of a tile.

    Parameters
    ----------
    values
        Digital numbers or electrons, shape (rows, columns).
    depth
        Depth [m] along the camera's axis from which the brightest ray to each pixel comes; NaN where the pupil sends no
        light, infinite where the ray meets no surface.
    saturated
        Number of saturated pixels.
    """

    values: NDArray[Any]
    depth: NDArray[np.float32]
    saturated: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Rendered(Recorded):
    """A recorded tile with the error of its sampling.

    Parameters
    ----------
    sampling_error
        Sums of squares over the middle of the tile [electrons²]: of its difference from a finer picture (16 times the
        samples and, by waves, twice as many spreads along each axis of their tables), and of the finer picture.
    """

    sampling_error: tuple[float, float]


def tiles_of(tile: Tile) -> list[Tile]:
    """Divide a whole picture, given as one tile, into tiles."""
    sensor = tile.exposure.sensor
    return [
        replace(tile, rows=(top, min(top + TILE[0], sensor.rows)), columns=(left, min(left + TILE[1], sensor.columns)))
        for top in range(0, sensor.rows, TILE[0])
        for left in range(0, sensor.columns, TILE[1])
    ]


def render_tile(tile: Tile) -> Rendered:
    """Render a tile, and estimate the error of its sampling, which for small tiles takes as long."""
    recorded = record_tile(tile)
    middles = ((tile.rows[0] + tile.rows[1]) // 2, (tile.columns[0] + tile.columns[1]) // 2)
    rows, columns = (
        (max(begin, middle - _PROBE // 2), min(end, middle + _PROBE // 2))
        for (begin, end), middle in zip((tile.rows, tile.columns), middles, strict=True)
    )
    coarse = replace(tile, rows=rows, columns=columns)
    light, _ = expected_electrons(coarse)
    waves = None if tile.waves is None else replace(tile.waves, fineness=2 * tile.waves.fineness)
    fine, _ = expected_electrons(replace(coarse, samples=FINER * tile.samples, waves=waves))
    return Rendered(
        values=recorded.values,
        depth=recorded.depth,
        saturated=recorded.saturated,
        sampling_error=(float(np.sum(np.square(light - fine))), float(np.sum(np.square(fine)))),
    )


def record_tile(tile: Tile) -> Recorded:
    """Render the light of a tile, then its noise."""
    expected, depth = expected_electrons(tile)
    point = f"{tile.camera}/{tile.exposure.name}/{tile.rows[0]}/{tile.columns[0]}"
    recording = tile.recording
    values = recording.record(expected, point_generator(seed=tile.seed, point=point, replicate=0))
    saturated = int(np.count_nonzero(expected >= recording.saturation_electrons))
    return Recorded(values=values, depth=depth, saturated=saturated)


def expected_electrons(tile: Tile) -> tuple[FloatArray, NDArray[np.float32]]:
    """Mean electrons and depth of every pixel."""
    shape = (tile.rows[1] - tile.rows[0], tile.columns[1] - tile.columns[0])
    electrons, depth = np.zeros(shape), np.zeros(shape, np.float32)
    rows, columns = np.mgrid[slice(*tile.rows), slice(*tile.columns)]
    for top, left in itertools.product(range(0, shape[0], _AT_ONCE[0]), range(0, shape[1], _AT_ONCE[1])):
        block = np.s_[top : top + _AT_ONCE[0], left : left + _AT_ONCE[1]]
        computed = electrons_at(tile, rows[block].ravel(), columns[block].ravel())
        electrons[block], depth[block] = (values.reshape(rows[block].shape) for values in computed)
    return electrons, depth


def electrons_at(
    tile: Tile, rows: NDArray[np.intp], columns: NDArray[np.intp]
) -> tuple[FloatArray, NDArray[np.float32]]:
    """Mean electrons and depths of single pixels of a picture; all their rays are in memory at once."""
    exposure, recording = tile.exposure, tile.recording
    sensor = exposure.sensor
    x = (columns.astype(float) + 0.5 - sensor.columns / 2.0) * sensor.pixel_pitch
    y = (rows.astype(float) + 0.5 - sensor.rows / 2.0) * sensor.pixel_pitch
    waves = tile.waves
    cones = exposure.cones(x, y, 0.0 if waves is None else waves.beyond)
    width = sensor.pixel_pitch * recording.pixel_fill
    if waves is None:
        lit = lit_area(cones, width) / (np.pi * cones.lens_radius**2) * cones.light
    else:
        lit = waves.tables(tile.samples)[tile.samples].passed_pixel(cones, width) * cones.light
    gain = np.asarray(recording.electrons_at_f1(sensor))
    color: NDArray[np.intp] | int = GREY
    scene = tile.scene.build()
    if recording.mosaic is not None:
        colors = recording.mosaic.colors(rows, columns)
        gain = gain * np.asarray(recording.mosaic.response)[colors]
        color = colors[cones.pixel]
    brightness, seen_at = np.zeros(lit.size), np.full(lit.size, np.nan)
    share = lit / cones.light
    for chosen, samples in (
        (np.flatnonzero(share > _DIM), tile.samples),
        (np.flatnonzero((share > 0.0) & (share <= _DIM)), fewer(tile.samples)),
    ):
        chosen_color = color if isinstance(color, int) else color[chosen]
        tables = None if waves is None else waves.tables(tile.samples)[samples]
        view = sight(scene, cones.only(chosen), exposure.pose, nodes(samples), width, chosen_color, tables)
        brightness[chosen], seen_at[chosen] = view.brightness, view.depth
    light: FloatArray = np.bincount(cones.pixel, weights=lit * brightness, minlength=x.size).astype(float)
    # The depth of a pixel is that which the lens with the most light sees.
    brightest = np.zeros(x.size)
    np.maximum.at(brightest, cones.pixel, lit)
    depth = np.full(x.size, np.nan, np.float32)
    winner = (lit > 0.0) & (lit >= brightest[cones.pixel])
    depth[cones.pixel[winner]] = seen_at[winner]
    return np.asarray(gain * light), depth
