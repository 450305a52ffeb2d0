"""A scene in two forms: its declaration, small enough to send to workers, and its surfaces with all their samples."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.imaging.scenes.pattern import Pattern
from tradestudy.imaging.scenes.surfaces import HeightField, PatternSource, Surface
from tradestudy.uncertainty.streams import point_generator

ROCK_SIDE: Final = 1024
_SAMPLES_PER_FEATURE: Final = 32
_FINEST: Final = 4.0  # in samples; a rock has no smaller features, so that its slopes do not depend on the grid


class SurfaceSource(Protocol):
    """The declaration of a surface, from which it is built."""

    @property
    def pattern(self) -> PatternSource:
        """Pattern on the surface."""

    @property
    def extent(self) -> tuple[float, float]:
        """Nearest and farthest depth [m]."""

    def build(self) -> Surface:
        """Build the surface; cached per process."""


@dataclass(frozen=True, kw_only=True)
class Rock:
    """A rough height field that repeats periodically: Gaussian noise, with a power law for its smaller features.

    Its spectrum is ``(1 + (2π ℓ ν)²)^(−1−h)``, that of a self-affine surface of Hurst exponent h.

    Parameters
    ----------
    near, far
        Depths of its highest and deepest point [m].
    feature_size
        ℓ [m].
    hurst
        h: 1 is smooth, 0 is rugged.
    seed
        Seed of the study.
    number
        Index among the surfaces of the scene, so that two rocks differ.
    pattern
        Pattern on it, by lateral position.

    Raises
    ------
    OutOfRangeError
        The range is empty or not positive, or the exponent is outside 0 to 1.
    """

    near: float
    far: float
    feature_size: float
    hurst: float
    seed: int
    number: int
    pattern: PatternSource

    def __post_init__(self) -> None:
        if not 0.0 < self.near < self.far:
            raise OutOfRangeError(
                "depth range of a rock", value=f"{self.near:g} to {self.far:g} m", limit="0 < near < far"
            )
        if not 0.0 <= self.hurst <= 1.0:
            raise OutOfRangeError("Hurst exponent of a rock", value=f"{self.hurst:g}", limit="0 to 1")

    @property
    def extent(self) -> tuple[float, float]:
        """Depths of its highest and deepest point [m]."""
        return self.near, self.far

    def build(self) -> HeightField:
        """Build the surface; cached per process."""
        return _rock(self)


@dataclass(frozen=True, kw_only=True)
class DepthMapSurface:
    """A surface given by a file of depths.

    Parameters
    ----------
    file, sha256
        Path of the map, and the hash of its content.
    unit
        Depth [m] per unit of its values.
    from_top
        Whether its first row is the top one.
    width
        Width of the whole map [m], seen along parallel lines; None if it is seen in perspective.
    field_of_view
        Angle across the whole map [rad], seen from a pinhole at the origin; None if it is seen along parallel lines.
    extent
        Nearest and farthest depth [m].
    pattern
        A picture with one pixel for each sample of the map, or a texture by lateral position.
    """

    file: Path
    sha256: str
    unit: float
    from_top: bool
    width: float | None
    field_of_view: float | None
    extent: tuple[float, float]
    pattern: PatternSource
    pattern_in_samples: bool

    def build(self) -> HeightField:
        """Build the surface; cached per process."""
        return _depth_map(self)


@dataclass(frozen=True, kw_only=True)
class SceneSource:
    """The declaration of a scene, from which it is built.

    Parameters
    ----------
    surfaces
        Declarations of its surfaces.
    background
        Brightness where there is no surface, relative to the mean of the texture.
    """

    surfaces: tuple[SurfaceSource, ...]
    background: float

    @property
    def extent(self) -> tuple[float, float]:
        """Nearest and farthest depth [m]."""
        ends = [end for surface in self.surfaces for end in surface.extent]
        return min(ends), max(ends)

    def build(self) -> Scene:
        """Build the scene with all its samples; cached per process."""
        return _scene(self)


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """Surfaces with their patterns, and the background.

    Parameters
    ----------
    surfaces, patterns
        The surfaces, and the pattern of each.
    background
        Brightness where a line of sight meets nothing.
    """

    surfaces: Sequence[Surface]
    patterns: Sequence[Pattern]
    background: float


@lru_cache(maxsize=2)
def _scene(source: SceneSource) -> Scene:
    return Scene(
        surfaces=[surface.build() for surface in source.surfaces],
        patterns=[surface.pattern.build() for surface in source.surfaces],
        background=source.background,
    )


@lru_cache(maxsize=4)
def _rock(rock: Rock) -> HeightField:
    from scipy import fft

    rng = point_generator(seed=rock.seed, point=f"rock {rock.number}", replicate=0)
    frequency = np.hypot(fft.rfftfreq(ROCK_SIDE)[None, :], fft.fftfreq(ROCK_SIDE)[:, None])
    shape = (1.0 + np.square(2.0 * math.pi * _SAMPLES_PER_FEATURE * frequency)) ** (-0.5 * (1.0 + rock.hurst))
    shape *= np.exp(-0.5 * np.square(_FINEST * frequency))
    spectrum = fft.rfft2(rng.standard_normal((ROCK_SIDE, ROCK_SIDE)), workers=-1) * shape
    noise = fft.irfft2(spectrum, s=(ROCK_SIDE, ROCK_SIDE), workers=-1)
    share = (noise - noise.min()) / np.ptp(noise)
    step = rock.feature_size / _SAMPLES_PER_FEATURE
    return HeightField(
        depths=(rock.near + (rock.far - rock.near) * share).astype(np.float32),
        corner=(-step * ROCK_SIDE / 2.0, -step * ROCK_SIDE / 2.0),
        step=step,
        perspective=False,
        repeats=True,
        pattern=rock.pattern,
    )


@lru_cache(maxsize=4)
def _depth_map(source: DepthMapSurface) -> HeightField:
    from tradestudy.imaging.scenes.pattern import read_depths

    depths = read_depths(source.file, source.unit)
    if not source.from_top:
        depths = depths[::-1]
    rows, columns = depths.shape
    perspective = source.width is None
    whole = source.width if source.width is not None else 2.0 * math.tan((source.field_of_view or 0.0) / 2.0)
    step = whole / columns
    return HeightField(
        depths=np.ascontiguousarray(depths, np.float32),
        corner=(-step * (columns - 1) / 2.0, -step * (rows - 1) / 2.0),
        step=step,
        perspective=perspective,
        repeats=False,
        pattern=source.pattern,
        pattern_in_samples=source.pattern_in_samples,
    )
