"""A simulated target observed through any camera model, and the priors of the camera's parameters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr, ndtri

from tradestudy.calibration.projection import move, rotation_matrix
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.uncertainty.streams import scrambled_sobol

CameraModel = Callable[[FloatArray, FloatArray], FloatArray]
"""Takes parameters (..., P) and points in the camera's frame (..., N, 3) [m]; returns observations (..., N, C), NaN for
points that are not visible. Leading axes broadcast."""


@dataclass(frozen=True, kw_only=True)
class Priors:
    """Independent normal priors, truncated at bounds, or uniform ones.

    Parameters
    ----------
    names : tuple of str, length P
        Names of the parameters.
    mean : array (P,)
        Means; for a uniform prior, the starting value.
    standard_deviation : array (P,)
        Standard deviations, > 0; inf for a uniform prior, which needs finite bounds.
    lower, upper : array (P,)
        Bounds; −inf and inf for none.

    Raises
    ------
    OutOfRangeError
        A shape differs, a deviation is not positive, a mean lies outside its bounds, or a uniform prior has no bounds.
    """

    names: tuple[str, ...]
    mean: FloatArray
    standard_deviation: FloatArray
    lower: FloatArray
    upper: FloatArray

    def __post_init__(self) -> None:
        for what in ("mean", "standard_deviation", "lower", "upper"):
            if getattr(self, what).shape != (len(self.names),):
                raise OutOfRangeError(
                    f"the priors' {what} does not match their names",
                    value=str(getattr(self, what).shape),
                    limit=f"({len(self.names)},)",
                    remedy="give one value per parameter",
                )
        bad = {
            "needs a positive standard deviation": ~(self.standard_deviation > 0.0),
            "is uniform without finite bounds": np.isinf(self.standard_deviation)
            & ~(np.isfinite(self.lower) & np.isfinite(self.upper)),
            "has its mean outside its bounds": ~((self.lower < self.mean) & (self.mean < self.upper)),
        }
        for what, where in bad.items():
            if np.any(where):
                index = int(np.argmax(where))
                raise OutOfRangeError(
                    f"the prior of {self.names[index]} {what}",
                    value=f"{self.mean[index]:g} ± {self.standard_deviation[index]:g}",
                    limit=f"{self.lower[index]:g} to {self.upper[index]:g}",
                    remedy="correct the prior",
                )

    @property
    def precision(self) -> FloatArray:
        """Inverse variances, shape (P,); zero for uniform priors."""
        return self.standard_deviation**-2.0

    @property
    def scale(self) -> FloatArray:
        """A typical scale of each parameter, shape (P,): its standard deviation, or a quarter of its range."""
        with np.errstate(invalid="ignore"):  # inf − inf of an unbounded normal, which is not selected
            width = (self.upper - self.lower) / 4.0
        return np.where(np.isinf(self.standard_deviation), width, self.standard_deviation)

    def log_density(self, parameters: FloatArray) -> FloatArray:
        """Logarithm of the prior up to a constant, −inf outside the bounds.

        Parameters
        ----------
        parameters : array (..., P)
            Parameters.
        """
        inside = np.all((parameters >= self.lower) & (parameters <= self.upper), axis=-1)
        square = np.sum(((parameters - self.mean) / self.standard_deviation) ** 2, axis=-1)
        return np.where(inside, -0.5 * square, -np.inf)

    def draw(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Draws from the prior, shape (count, P).

        Parameters
        ----------
        rng : numpy.random.Generator
            Random-number generator.
        count : int
            Number of draws.
        """
        uniform = rng.random((count, len(self.names)))
        flat = np.isinf(self.standard_deviation)
        spread = np.where(flat, 1.0, self.standard_deviation)
        low, high = ndtr((self.lower - self.mean) / spread), ndtr((self.upper - self.mean) / spread)
        normal = self.mean + spread * ndtri(low + uniform * (high - low))
        box_low, box_high = np.where(flat, self.lower, 0.0), np.where(flat, self.upper, 0.0)
        return np.where(flat, box_low + uniform * (box_high - box_low), normal)


@dataclass(frozen=True, kw_only=True)
class SyntheticTarget:
    """A rigid set of points seen by a camera in several poses.

    Parameters
    ----------
    points : array (N, 3)
        Points in the target's frame [m].
    poses : array (V, 6)
        Nominal poses from target to camera: rotation vector [rad] and translation [m].
    noise : array (C,)
        Standard deviation of each component of an observation, in its unit.
    rotation_deviation, translation_deviation : float
        Standard deviations of each component of the poses [rad], [m]; inf for unknown poses, as of a hand-held board.

    Raises
    ------
    OutOfRangeError
        A noise or a standard deviation is not positive.
    """

    points: FloatArray
    poses: FloatArray
    noise: FloatArray
    rotation_deviation: float = np.inf
    translation_deviation: float = np.inf

    def __post_init__(self) -> None:
        smallest = min(float(np.min(self.noise)), self.rotation_deviation, self.translation_deviation)
        if not smallest > 0.0:
            raise OutOfRangeError(
                "a simulated target needs positive noise and positive standard deviations of its poses",
                value=f"{smallest:g}",
                limit="> 0",
                remedy="set a small deviation for well-known poses, inf for unknown ones",
            )

    @property
    def pose_precision(self) -> FloatArray:
        """Inverse variances of the components of a pose, shape (6,); zero where unknown."""
        return np.repeat([self.rotation_deviation**-2.0, self.translation_deviation**-2.0], 3)


def spread_poses(
    count: int, distances: tuple[float, float], half_field: float, tilt: float, rng: np.random.Generator
) -> FloatArray:
    """Poses of a target in the field of view, spread evenly over 1/Z, field and tilt by a scrambled Sobol sequence.

    A longer sequence begins with the shorter one, so that additional views never make a calibration less certain.

    Parameters
    ----------
    count : int
        Number of poses V.
    distances : (float, float)
        Nearest and farthest distance of the target's origin [m].
    half_field : float
        Largest slope of the direction to the target's origin, in x and in y [1].
    tilt : float
        Standard deviation of each component of the rotation vector [rad].
    rng : numpy.random.Generator
        Random-number generator for the scrambling.

    Returns
    -------
    array (V, 6)
        Rotation vectors [rad] and translations [m].
    """
    shares = scrambled_sobol(6, rng)(count)
    depth = 1.0 / (1.0 / distances[0] + shares[0] * (1.0 / distances[1] - 1.0 / distances[0]))
    slopes = half_field * (2.0 * shares[1:3] - 1.0)
    return np.column_stack([*(tilt * ndtri(shares[3:])), *(slopes * depth), depth])


def faces(poses: FloatArray) -> BoolArray:
    """Whether boards in poses (V, 6) turn their printed side to the camera; (V,).

    The camera sees that side where the board's normal, along z at zero rotation, points away from it.
    """
    normal, towards = rotation_matrix(poses[:, :3])[..., 2], poses[:, 3:]
    return np.asarray(np.sum(normal * towards, axis=-1) > 0.0)


def flat_grid(columns: int, rows: int, spacing: float) -> FloatArray:
    """Corners of a flat board about its centre, shape (columns · rows, 3) [m].

    Parameters
    ----------
    columns, rows : int
        Number of corners along x and y.
    spacing : float
        Size of a square [m].
    """
    x, y = np.meshgrid(np.arange(columns) - (columns - 1) / 2.0, np.arange(rows) - (rows - 1) / 2.0)
    return spacing * np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])


def observe_target(
    target: SyntheticTarget, model: CameraModel, parameters: FloatArray, rng: np.random.Generator
) -> FloatArray:
    """Measurements of the target by a camera with these parameters.

    Parameters
    ----------
    target : SyntheticTarget
        Points, poses, noise.
    model : CameraModel
        The camera.
    parameters : array (P,)
        Its true parameters.
    rng : numpy.random.Generator
        Random-number generator for the noise, and for the true poses if their deviations are finite.

    Returns
    -------
    array (V, N, C)
        Observations with noise; NaN where a point is not visible.
    """
    deviation = np.repeat([target.rotation_deviation, target.translation_deviation], 3)
    offset = np.where(np.isfinite(deviation), deviation, 0.0) * rng.standard_normal(target.poses.shape)
    observed = model(parameters, move(target.poses + offset, target.points))
    return observed + target.noise * rng.standard_normal(observed.shape)
