"""Evaluation of a model on draws: ranked outputs, the alignment of draws, and independent replicates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import FloatArray
from tradestudy.uncertainty.sources import Sources
from tradestudy.uncertainty.streams import point_generator, scrambled_sobol

Model = Callable[[Mapping[str, FloatArray]], FloatArray]
"""Takes every parameter by name, shape (draws, 1), and returns the outputs, shape (draws, outputs); NaN for none."""


def depth_from_inverse(inverse_depth: FloatArray) -> FloatArray:
    """Depth Z = 1/w; w <= 0 is a point at or beyond infinity and becomes +∞.

    Parameters
    ----------
    inverse_depth : array, any shape
        w [1/m]; NaN stays NaN.
    """
    positive = inverse_depth > 0.0
    with np.errstate(over="ignore"):  # a subnormal inverse depth counts as infinity
        if np.all(positive):
            return np.asarray(1.0 / inverse_depth)
        depth = np.where(np.isnan(inverse_depth), np.nan, np.inf)
        np.divide(1.0, inverse_depth, out=depth, where=positive)
    return depth


def ranked(outputs: FloatArray, *, inverse_depth: bool, draws: int) -> FloatArray:
    """Outputs of a model as (outputs, draws), or the depths of inverse depths; NaN where a draw has no rank.

    An output of +∞ has the last rank, NaN and −∞ have none. An infinite inverse depth has none either.
    """
    values = np.asarray(outputs, float)
    if values.ndim != 2 or values.shape[0] != draws:
        raise OutOfRangeError(
            "a model returned an array of the wrong shape",
            value=f"{values.shape}",
            limit=f"({draws}, outputs)",
            remedy="make the parameters, each of shape (draws, 1), broadcast against the outputs",
        )
    values = np.ascontiguousarray(values.T)
    unranked = np.isinf(values) if inverse_depth else values == -np.inf
    if np.any(unranked):
        values = np.where(unranked, np.nan, values)
    return depth_from_inverse(values) if inverse_depth else values


@dataclass(frozen=True, kw_only=True, eq=False)
class ScoreAlignment:
    """A rotation of the standard normal scores that assigns the first coordinates to what changes the outputs most.

    Quasi-random points are most even in their first coordinates. A rotation does not change the distribution of
    independent normal scores, so it affects the error of a result but not its expectation (Imai and Tan 2006).

    Parameters
    ----------
    reflectors : array, shape (directions, dimensions)
        Unit normals of the Householder reflections whose product is the rotation; empty for no rotation.
    """

    reflectors: FloatArray

    def apply(self, scores: FloatArray) -> FloatArray:
        """Rotate scores (dimensions, n) in place, in a fixed order of operations, and return them."""
        for normal in self.reflectors[::-1]:
            projection = np.zeros(scores.shape[1])
            for weight, row in zip(normal, scores, strict=True):
                projection += weight * row
            for weight, row in zip(normal, scores, strict=True):
                row -= 2.0 * weight * projection
        return scores


UNALIGNED = ScoreAlignment(reflectors=np.empty((0, 0)))
"""No rotation: coordinates in the order of the sources."""

# More directions bring no gain; the remaining coordinates take care of weaker ones.
_MOST_DIRECTIONS = 4
_WEAKEST_DIRECTION = 1e-3


def alignment_with(models: Sequence[Model], sources: Sources) -> ScoreAlignment:
    """Align the scores with the principal directions of the outputs' response to each of them.

    Parameters
    ----------
    models : sequence of Model
        Models whose draws are compared or reported together; each is evaluated at scores of ± 1.
    sources : Sources
        The uncertain sources.

    Returns
    -------
    ScoreAlignment
        Outputs that are not finite at one of these points are ignored; if none remains, nothing is rotated.
    """
    size = sources.dimensions
    if size < 2:
        return UNALIGNED
    scores = np.concatenate([np.eye(size), -np.eye(size)], axis=1)
    parameters = sources.draw(scores)
    responses = np.concatenate([ranked(model(parameters), inverse_depth=False, draws=2 * size) for model in models])
    responses = responses[np.all(np.isfinite(responses), axis=1)]
    difference = responses[:, :size] - responses[:, size:]
    # Unit length makes outputs count alike: those at far distances would otherwise outweigh those at near ones.
    norm = np.linalg.norm(difference, axis=1, keepdims=True)
    directions = (difference / np.where(norm > 0.0, norm, 1.0)).T
    if not np.any(directions):
        return UNALIGNED
    left, strength, _ = np.linalg.svd(directions, full_matrices=False)
    count = int(np.sum(strength > _WEAKEST_DIRECTION * strength[0]))
    return ScoreAlignment(reflectors=_reflectors(left[:, : min(count, _MOST_DIRECTIONS, size - 1)]))


def _reflectors(columns: FloatArray) -> FloatArray:
    """Normals of Householder reflections whose product has these orthonormal columns, up to sign, as its first ones.

    The sign of a singular direction is arbitrary. The remainder of each column is oriented so that its largest
    component is positive. Its first component is then never near −1, where the reflection would not exist, and the
    product changes from one design to the next no more than the columns do.
    """
    rest, normals = columns.copy(), np.zeros((columns.shape[1], columns.shape[0]))
    for k, normal in enumerate(normals):
        normal[k:] = rest[k:, k]
        normal *= np.sign(normal[np.argmax(np.abs(normal))])
        normal[k] += np.linalg.norm(normal)
        normal /= np.linalg.norm(normal)
        rest -= 2.0 * np.outer(normal, normal @ rest)
    return normals


class Replicate:
    """One independent replicate of the draws of a model, which can be extended without starting again.

    Parameters
    ----------
    model : Model
        The vectorised model.
    sources : Sources
        The uncertain sources.
    seed, point, replicate
        Identity of the random stream (see :func:`tradestudy.uncertainty.streams.point_generator`).
    alignment : ScoreAlignment
        The combinations of sources that get the best coordinates; compared replicates share it.
    inverse_depth : bool
        Whether the model returns inverse depth; values are then stored as depth.
    """

    def __init__(
        self,
        model: Model,
        sources: Sources,
        *,
        seed: int,
        point: str,
        replicate: int,
        alignment: ScoreAlignment,
        inverse_depth: bool,
    ) -> None:
        self._model, self._sources, self._inverse_depth = model, sources, inverse_depth
        self._alignment = alignment
        rng = point_generator(seed=seed, point=point, replicate=replicate)
        self._uniform = scrambled_sobol(sources.dimensions, rng)
        self.values: FloatArray = np.empty((0, 0))  # (outputs, draws); NaN where a draw has no rank

    @property
    def draws(self) -> int:
        """Number of draws so far."""
        return int(self.values.shape[1])

    def lengthen(self, draws: int, batch_draws: int) -> None:
        """Evaluate up to this number of draws; the batch size affects memory and speed, but not results."""
        from scipy.special import ndtri  # imported here, so that checking a study does not load it

        blocks = [self.values] if self.draws else []
        done = self.draws
        while done < draws:
            # Batches end at multiples of their size, so that a Sobol sequence always delivers whole blocks.
            size = min(batch_draws, draws - done)
            parameters = self._sources.draw(self._alignment.apply(ndtri(self._uniform(size))))
            blocks.append(ranked(self._model(parameters), inverse_depth=self._inverse_depth, draws=size))
            done += size
        self.values = np.concatenate(blocks, axis=1) if len(blocks) > 1 else blocks[0]
