"""The inputs of `propagate_through` as error sources: single distributions, and inputs that are drawn together.

Values of pandas and scipy are recognised by their attributes, so that neither has to be loaded.
"""

from __future__ import annotations

import math
import numbers
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from tradestudy.errors import OutOfRangeError
from tradestudy.uncertainty.distributions import Distribution, FloatArray, FrozenDistribution
from tradestudy.uncertainty.joint import GaussianCopula, JointDraws, JointNormal
from tradestudy.uncertainty.sources import ErrorClass, Group, Source, Sources
from tradestudy.wording import few

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike
    from scipy.stats._multivariate import multivariate_normal_frozen

    Inputs = Mapping[Any, Any] | Sequence[Any] | FloatArray | pd.DataFrame | pd.Series[Any] | multivariate_normal_frozen
    Covariance = ArrayLike | pd.DataFrame

Names = tuple[str, ...]
Correlation = Mapping[tuple[str, str], float]


def sources_of(inputs: Any, *, covariance: Any = None, correlation: Correlation | None = None) -> tuple[Sources, bool]:
    """Sources of the inputs in their order, and whether the function takes them by position because they have no names.

    Raises
    ------
    OutOfRangeError
        An input is none of those that `propagate_through` describes, or the covariance or a correlation names an input
        whose distribution is given otherwise.
    """
    by_position, entries = _entries(inputs)
    single = {names[0]: value for names, value in entries.items() if _is_single(names, value)}
    groups = [_joint(names, value) for names, value in entries.items() if not _is_single(names, value)]
    if covariance is not None:
        tied = _joint_normal(single, covariance)
        groups.append(tied)
        single = {name: value for name, value in single.items() if name not in tied.parameters}
    marginals = {name: _distribution(name, value) for name, value in single.items()}
    if correlation is not None:
        _require_correlations(marginals, correlation, [name for group in groups for name in group.parameters])
    if correlation:
        groups.append(_copula(marginals, correlation))
    else:
        groups += [
            Source(name=name, distribution=marginal, error_class=ErrorClass.RIG) for name, marginal in marginals.items()
        ]
    return Sources(groups=tuple(groups)), by_position


def _entries(inputs: Any) -> tuple[bool, dict[Names, Any]]:
    """What is given for each input or each tuple of joint inputs, and whether their names are only numbers."""
    if _is_frame(inputs):
        return False, {_frame_names("the columns of the draws", inputs.columns): inputs}
    if hasattr(inputs, "to_dict") and not isinstance(inputs, Mapping):  # a Series, such as the means of a DataFrame
        inputs = inputs.to_dict()
    if isinstance(inputs, Mapping):
        entries = {key if isinstance(key, tuple) else (key,): value for key, value in inputs.items()}
        names = [name for key in entries for name in key]
        if len(entries) == len(inputs) and names and all(entries) and all(isinstance(name, str) for name in names):
            return False, entries
    elif _is_normal(inputs):
        return True, {_numbered(np.size(inputs.mean)): inputs}
    elif isinstance(inputs, list | tuple | np.ndarray) and np.size(listed := np.asarray(inputs, dtype=object)):
        if listed.ndim == 2:
            return True, {_numbered(listed.shape[1]): inputs}
        if listed.ndim == 1:
            return True, {(name,): value for name, value in zip(_numbered(listed.size), inputs, strict=True)}
    raise OutOfRangeError(
        "inputs",
        value=_shown(inputs),
        limit="at least one distribution by name, a sequence of distributions, or joint draws",
        remedy='give {"x": Normal(…)}',
    )


def _numbered(count: int) -> Names:
    return tuple(str(number) for number in range(1, count + 1))


def _frame_names(what: str, names: Iterable[Any]) -> Names:
    """Names of the columns or rows of a data frame, refused unless each is text and occurs once."""
    listed = tuple(names)
    if not listed or len(set(listed)) < len(listed) or not all(isinstance(name, str) for name in listed):
        raise OutOfRangeError(
            f"the names of {what}",
            value=", ".join(map(repr, listed)),
            limit="a distinct name for each",
            remedy="name them after the arguments of the function",
        )
    return listed


def _joint(names: Names, joint: Any) -> Group:
    """The group of inputs that are drawn together: by rows of draws, or from a multivariate normal distribution."""
    shared = f"the inputs {few(names)}"
    if _is_normal(joint):
        means = np.atleast_1d(joint.mean)
        if means.size != len(names):
            raise OutOfRangeError(
                shared, value=f"a normal distribution of {means.size} variables", limit=f"{len(names)}"
            )
        return JointNormal(
            name=shared, parameters=names, mean=means, covariance=np.atleast_2d(joint.cov), error_class=ErrorClass.RIG
        )
    if _is_frame(joint):
        columns = _frame_names("the columns of the draws", joint.columns)
        if set(columns) != set(names):
            raise OutOfRangeError(
                f"the columns of the draws of {shared}", value=", ".join(columns), limit=", ".join(names)
            )
        joint = joint[list(names)]
    draws = _numbers(f"the draws of {shared}", joint)
    if draws.ndim != 2 or draws.shape[1] != len(names) or draws.shape[0] < draws.shape[1]:
        raise OutOfRangeError(
            f"the draws of {shared}",
            value=f"shape {draws.shape}",
            limit=f"(draws, {len(names)}), with at least as many draws as inputs",
            remedy="give a row for each draw and a column for each input",
        )
    return JointDraws(name=shared, parameters=names, draws=draws, error_class=ErrorClass.RIG)


def _joint_normal(single: Mapping[str, Any], covariance: Any) -> JointNormal:
    """Jointly normal inputs, whose means are the numbers that are given for them."""
    if _is_frame(covariance):
        names = _frame_names("the columns of the covariance", covariance.columns)
        rows = _frame_names("the rows of the covariance", covariance.index)
        if set(rows) != set(names):
            raise OutOfRangeError(
                "the rows of the covariance",
                value=", ".join(rows),
                limit=f"the same names as its columns: {', '.join(names)}",
            )
    else:
        names = tuple(single)
    if unknown := [name for name in names if not isinstance(single.get(name), numbers.Real)]:
        raise OutOfRangeError(
            "the covariance names inputs without a mean",
            value=", ".join(unknown),
            limit=", ".join(name for name, value in single.items() if isinstance(value, numbers.Real)) or "none",
            remedy="give the mean of each of them, a number, among the inputs",
        )
    names = tuple(name for name in single if name in names)
    if _is_frame(covariance):
        covariance = covariance.loc[list(names), list(names)]
    return JointNormal(
        name="covariance",
        parameters=names,
        mean=np.array([float(single[name]) for name in names]),
        covariance=_numbers("the covariance", covariance),
        error_class=ErrorClass.RIG,
    )


def _distribution(name: str, value: Any) -> Distribution:
    """The distribution of a single input."""
    if not _is_distribution(value):
        several = isinstance(value, list | tuple) or np.ndim(value) > 0 or hasattr(value, "to_numpy")
        raise OutOfRangeError(
            f"input {name!r}",
            value=_shown(value),
            limit="a distribution",
            remedy="give draws of several inputs as one DataFrame, which keeps their correlation, and draws that are "
            "independent of other inputs as Empirical(…)"
            if several
            else "give Normal(…), Uniform(…) or another, or a number with a covariance that names it",
        )
    if hasattr(value, "quantile"):
        distribution: Distribution = value
        return distribution
    try:
        median, mean = np.asarray(value.ppf(0.5) if hasattr(value, "ppf") else value.icdf(0.5)), value.mean()
        deviation = value.std() if hasattr(value, "std") else value.standard_deviation()
    except TypeError:  # a family of distributions, such as stats.gamma, without its parameters
        median = mean = deviation = np.asarray(math.nan)
    if median.ndim > 0 or not math.isfinite(median) or hasattr(value, "freeze"):
        raise OutOfRangeError(
            f"input {name!r}",
            value=_shown(value),
            limit="one distribution with valid parameters",
            remedy="give numbers as its parameters, such as scipy.stats.norm(0.0, 0.1)",
        )
    exists = [float(moment) if math.isfinite(moment) else None for moment in (mean, deviation)]
    return FrozenDistribution(frozen=value, mean=exists[0], standard_deviation=exists[1])


def _numbers(what: str, value: Any) -> FloatArray:
    """Array of real numbers."""
    try:
        array = np.asarray(value)
        if array.dtype.kind in "buif" and not np.ma.is_masked(value):
            return array.astype(np.float64)
    except ValueError:  # rows of unequal length
        pass
    raise OutOfRangeError(what, value=_shown(value), limit="real numbers")


def _shown(value: Any) -> str:
    return repr(value) if len(repr(value)) <= 60 else f"a {type(value).__name__}"


def _is_frame(value: Any) -> bool:
    return hasattr(value, "columns") and hasattr(value, "to_numpy")


def _is_normal(value: Any) -> bool:
    """Whether this is a frozen multivariate normal distribution."""
    return hasattr(value, "cov_object")


def _is_single(names: Names, value: Any) -> bool:
    return len(names) == 1 and not (_is_frame(value) or _is_normal(value))


def _is_distribution(value: Any) -> bool:
    ours = hasattr(value, "quantile") and hasattr(value, "standard_deviation")
    return ours or hasattr(value, "ppf") or hasattr(value, "icdf")


def _copula(marginals: Mapping[str, Distribution], correlation: Correlation) -> GaussianCopula:
    names = tuple(marginals)
    matrix = np.eye(len(names))
    for (first, second), value in correlation.items():
        matrix[names.index(first), names.index(second)] = matrix[names.index(second), names.index(first)] = value
    return GaussianCopula(
        name="inputs",
        parameters=names,
        marginals=tuple(marginals.values()),
        correlation=matrix,
        error_class=ErrorClass.RIG,
    )


def _require_correlations(inputs: Mapping[str, Distribution], correlation: Correlation, joint: Sequence[str]) -> None:
    if not isinstance(correlation, Mapping):
        raise OutOfRangeError("correlation", value=repr(correlation), limit="pairs of names with their correlation")
    for pair, value in correlation.items():
        if not (isinstance(pair, tuple) and len(pair) == 2):
            raise OutOfRangeError(
                "a correlation", value=repr(pair), limit="a pair of names", remedy='give it as {("x", "y"): 0.5}'
            )
        if together := [name for name in pair if name in joint]:
            raise OutOfRangeError(
                "a correlation of an input whose joint distribution is given",
                value=", ".join(together),
                limit=", ".join(inputs) or "none",
                remedy="include the correlation in the joint distribution",
            )
        if unknown := [name for name in pair if name not in inputs]:
            raise OutOfRangeError(
                "a correlation names an unknown input", value=", ".join(map(str, unknown)), limit=", ".join(inputs)
            )
        if pair[0] == pair[1] or not (isinstance(value, numbers.Real) and -1.0 <= value <= 1.0):
            raise OutOfRangeError(
                f"the correlation of {pair[0]} and {pair[1]}",
                value=repr(value),
                limit="a number from −1 to 1, of two inputs",
            )
        if constant := [name for name in pair if inputs[name].standard_deviation == 0.0]:
            raise OutOfRangeError(
                "a correlation with a constant input",
                value=", ".join(constant),
                limit="inputs that vary",
                remedy="leave the correlation out",
            )
        if correlation.get(pair[::-1], value) != value:
            raise OutOfRangeError(
                f"two correlations of {pair[0]} and {pair[1]}",
                value=f"{value:g} and {correlation[pair[::-1]]:g}",
                limit="one value",
                remedy="give each pair once",
            )
