"""The cheapest set of models whose omissions together stay within the accuracy wanted."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from tradestudy.accuracy import Accuracy, Quantity
from tradestudy.effects.base import Model, Slot, SlotName
from tradestudy.errors import UnaffordableError
from tradestudy.optics.arrays import FloatArray
from tradestudy.units import DURATION, FRACTION, pretty

Chosen = Mapping[SlotName, Model]
_MOST_SETS = 200_000
_CANNOT = "the accuracy wanted cannot be had"


@dataclass(frozen=True, kw_only=True)
class Decision:
    """What became of one model, and why.

    Parameters
    ----------
    slot, model
        The effect and the way to treat it.
    chosen, forced
        Whether it acts, and whether the study insists on it.
    seconds
        Predicted cost of the set that acts, with this model in its slot [s]; where it cannot be combined with the
        others, with the cheapest change of one more slot, infinite without any.
    why
        One sentence: the change, the limit, and what else decided.
    """

    slot: SlotName
    model: Model
    chosen: bool
    forced: bool
    seconds: float
    why: str


@dataclass(frozen=True, kw_only=True)
class Selection:
    """One model for every slot.

    Parameters
    ----------
    chosen
        The model of each slot.
    decisions
        Every model of every slot, accepted or refused.
    bounds
        Sum of the bounds of the chosen models, for each quantity that was asked for; forced models included.
    seconds
        Predicted cost of the set [s].
    """

    chosen: Chosen
    decisions: tuple[Decision, ...]
    bounds: Mapping[Quantity, float]
    seconds: float

    def name_of(self, slot: SlotName) -> str:
        """Name of the chosen model of a slot."""
        return self.chosen[slot].name


def sum_of_seconds(chosen: Chosen) -> float:
    """Cost of a set whose models do not share work."""
    return math.fsum(model.seconds for model in chosen.values())


def select(
    slots: Sequence[Slot],
    *,
    quantities: Sequence[Quantity],
    accuracy: Accuracy,
    forced: Mapping[SlotName, str] | None = None,
    seconds: Callable[[Chosen], float] = sum_of_seconds,
) -> Selection:
    """Choose the cheapest set of models whose bounds, added up, fit the accuracy of every quantity and the budget.

    The search is over every combination; among equally cheap sets the one with the smallest bounds wins, then the one
    that is simpler in the earlier slots, so that the outcome depends on nothing but the arguments.

    Parameters
    ----------
    slots
        Each at most once.
    quantities
        What is asked for.
    accuracy
        What omissions may change, and the time.
    forced
        Models that the study insists on; their own bounds are reported but held against nothing.
    seconds
        Predicted cost of a set, where the costs of its models do not just add up; infinite for models that cannot be
        combined.

    Raises
    ------
    UnaffordableError
        If no set fits; names what is missing and the nearest accuracy that can be afforded.
    OutOfRangeError
        If a forced model does not exist.
    """
    forced = {} if forced is None else forced
    open_models = [(slot.model(forced[slot.name]),) if slot.name in forced else slot.models for slot in slots]
    count = math.prod(map(len, open_models))
    if count > _MOST_SETS:
        raise UnaffordableError("sets of models", value=str(count), limit=str(_MOST_SETS), remedy="force some effects")
    wanted = np.array([accuracy.relative[quantity] for quantity in quantities])
    changes = _sums(  # (sets, quantities); forced models count nothing
        [
            np.array([[0.0 if slot.name in forced else one.change_of(q) for q in quantities] for one in models])
            for slot, models in zip(slots, open_models, strict=True)
        ]
    )
    counts = [len(models) for models in open_models]

    def chosen_of(index: int) -> Chosen:
        places = np.unravel_index(index, counts)
        return {slot.name: models[k] for slot, models, k in zip(slots, open_models, places, strict=True)}

    shortfall = (changes / wanted).max(axis=1) if wanted.size else np.zeros(count)
    fitting = np.flatnonzero(shortfall <= 1.0)
    added = seconds is sum_of_seconds
    costs = (
        _sums([np.array([[one.seconds] for one in models]) for models in open_models])[fitting, 0]
        if added
        else np.array([seconds(chosen_of(int(i))) for i in fitting])
    )
    affordable = (costs <= accuracy.budget) & np.isfinite(costs)
    if not affordable.any():
        ranked = np.argsort(shortfall, kind="stable")
        raise _nothing_fits(lambda: (chosen_of(int(i)) for i in ranked), quantities, accuracy, forced, seconds, costs)
    order = np.lexsort((fitting[affordable], shortfall[fitting[affordable]], costs[affordable]))
    best = int(fitting[affordable][order[0]])
    chosen = chosen_of(best)
    totals = {q: math.fsum(model.change_of(q) for model in chosen.values()) for q in quantities}
    return Selection(
        chosen=chosen,
        decisions=tuple(_decisions(slots, chosen, totals, accuracy, forced, seconds)),
        bounds=totals,
        seconds=float(costs[affordable][order[0]]),
    )


def _sums(parts: Sequence[FloatArray]) -> FloatArray:
    """Sums over every combination of one row of each part, in the order of `itertools.product`."""
    return reduce(lambda total, own: (total[:, np.newaxis] + own).reshape(-1, own.shape[1]), parts)


def _decisions(
    slots: Sequence[Slot],
    chosen: Chosen,
    totals: Mapping[Quantity, float],
    accuracy: Accuracy,
    forced: Mapping[SlotName, str],
    seconds: Callable[[Chosen], float],
) -> list[Decision]:
    found = []
    held = {q: math.fsum(one.change_of(q) for name, one in chosen.items() if name not in forced) for q in totals}
    least = seconds(chosen)
    for slot in slots:
        own = chosen[slot.name]
        for model in slot.models:
            is_forced = slot.name in forced and model is own
            cost = least if model is own else seconds({**chosen, slot.name: model})
            found.append(
                Decision(
                    slot=slot.name,
                    model=model,
                    chosen=model is own,
                    forced=is_forced,
                    seconds=cost if math.isfinite(cost) else _cheapest_beside(slot, model, slots, chosen, seconds),
                    why=_why(
                        model, own, held, accuracy, (cost, least), is_forced=is_forced, slot_forced=slot.name in forced
                    ),
                )
            )
    return found


def _cheapest_beside(
    slot: Slot, model: Model, slots: Sequence[Slot], chosen: Chosen, seconds: Callable[[Chosen], float]
) -> float:
    """Cost of the set that acts with a model in its slot and another one in any other slot, the least."""
    return min(
        (
            seconds({**chosen, slot.name: model, other.name: one})
            for other in slots
            if other is not slot
            for one in other.models
        ),
        default=math.inf,
    )


def _why(
    model: Model,
    own: Model,
    totals: Mapping[Quantity, float],
    accuracy: Accuracy,
    costs: tuple[float, float],
    *,
    is_forced: bool,
    slot_forced: bool,
) -> str:
    """One sentence with the number and the limit that it was held against."""
    quantity, change = _worst(model, totals, accuracy)
    wanted = accuracy.relative[quantity] if totals else math.nan
    held = f"changes {_words(quantity)} by {_at_most(change)}, {100.0 * wanted:.4g} % wanted" if totals else "not asked"
    if is_forced:
        return f"forced by the study; {held}"
    if slot_forced:
        return f"the study forces {own.name}; {held}"
    if model is own:
        return f"accepted: {held}"
    if change > wanted:
        return f"refused: {held}"
    joint = max(
        ((total - own.change_of(q) + model.change_of(q)) / accuracy.relative[q] for q, total in totals.items()),
        default=0.0,
    )
    if joint > 1.0:
        return f"refused: {held}, but with the other omissions {_above(100.0 * joint * wanted, 100.0 * wanted)} %"
    cost, least = costs
    if math.isinf(cost):
        return f"not taken: {held}, but it cannot be combined with the other models that act"
    if cost > least:
        return f"not needed: {held}, and {own.name} suffices, for {_told_apart(least, cost)}"
    return f"not taken: {held}, and {own.name}, which leaves out no more, costs no more"


def _worst(model: Model, totals: Mapping[Quantity, float], accuracy: Accuracy) -> tuple[Quantity, float]:
    if not totals:
        return "depth_uncertainty", 0.0
    quantity = max(totals, key=lambda q: model.change_of(q) / accuracy.relative[q])
    return quantity, model.change_of(quantity)


def _nothing_fits(
    by_shortfall: Callable[[], Iterator[Chosen]],
    quantities: Sequence[Quantity],
    accuracy: Accuracy,
    forced: Mapping[SlotName, str],
    seconds: Callable[[Chosen], float],
    fitting_costs: np.ndarray[tuple[int, ...], np.dtype[np.float64]],
) -> UnaffordableError:
    """Say what is missing, which effects stand in the way, and the nearest accuracy that the budget allows."""
    nearest = next((one for one in by_shortfall() if seconds(one) <= min(accuracy.budget, 1e300)), None)
    if nearest is None:
        return _no_set(min(map(seconds, by_shortfall())), accuracy.budget)
    free = {name: model for name, model in nearest.items() if name not in forced}
    changes = {q: math.fsum(model.change_of(q) for model in free.values()) for q in quantities}
    limited = math.isfinite(accuracy.budget)
    remedy = _offer(changes, accuracy, f" in {seconds(nearest):.3g} s" if limited else "")
    if limited:
        remedy += "; or raise the budget"
    if np.isfinite(fitting_costs).any():
        return UnaffordableError(
            f"{_CANNOT}: the cheapest set of models that is accurate enough takes {fitting_costs.min():.3g} s",
            limit=f"within {accuracy.budget:g} s",
            remedy=remedy,
        )
    worst = max(quantities, key=lambda q: changes[q] / accuracy.relative[q])
    which = " that can be combined" * bool(fitting_costs.size) + f" within {accuracy.budget:g} s" * limited
    return UnaffordableError(
        f"the accuracy wanted of {_words(worst)} cannot be had; even the most accurate models{which} leave",
        value=_what_remains(free, worst, changes[worst], accuracy.relative[worst]),
        limit=f"{100.0 * accuracy.relative[worst]:.4g} %",
        remedy=remedy,
    )


def _no_set(least: float, budget: float) -> UnaffordableError:
    if math.isinf(least):
        return UnaffordableError(
            "models that are forced together cannot be combined",
            remedy="force fewer: diffraction of a spot is off at both lenses or at none, and rays fill whole pixels",
        )
    return UnaffordableError(
        f"{_CANNOT}: even the cheapest set of models takes {least:.3g} s",
        limit=f"within {budget:g} s",
        remedy="raise the budget",
    )


def _what_remains(free: Chosen, quantity: Quantity, total: float, wanted: float) -> str:
    """The change by a whole set, and its largest parts with the models that make them."""
    changes = {f"{name.replace('_', ' ')} ({model.name})": model.change_of(quantity) for name, model in free.items()}
    parts = sorted(((change, head) for head, change in changes.items() if change >= 0.1 * total), reverse=True)
    named = ", ".join(f"{head} {_share(change)}" for change, head in parts)
    return f"{_share(total) if math.isinf(total) else _above(100.0 * total, 100.0 * wanted) + ' %'}, of which {named}"


def _offer(changes: Mapping[Quantity, float], accuracy: Accuracy, within: str) -> str:
    """What to ask for in place of what is exceeded; of each quantity where there are several."""
    missing = {q: change for q, change in changes.items() if change > accuracy.relative[q] * (1.0 - 1e-12)}
    most = max(missing.values())
    if most > 1.0:
        least = "no set of models has a finite bound" if math.isinf(most) else "not even 100 % can be had"
        return f"{least}; models that a study names under 'effects' are held against no bound"
    texts = {q: f"{_rounded_up(100.0 * change)} %" for q, change in missing.items()}
    several = " and ".join(f"{text} of {_words(q)}" for q, text in texts.items())
    return f"{several if len(texts) > 1 else next(iter(texts.values()))} can be had{within}; ask for that"


def _above(number: float, limit: float) -> str:
    """Two digits, or as many as tell the number from a limit that it exceeds."""
    texts = (f"{float(f'{number:.{digits}g}'):.15g}" for digits in range(2, 16))
    return next((text for text in texts if float(text) > limit), f"{number!r}")


def _rounded_up(number: float) -> str:
    """Two digits of a percentage up to 100, never less than the number."""
    step = 10.0 ** (math.floor(math.log10(number)) - 1)
    return f"{min(math.ceil(number / step * (1.0 + 1e-9)) * step, 100.0):.12g}"


def _at_most(value: float) -> str:
    return "an amount without bound" if math.isinf(value) else f"at most {_share(value)}"


def _share(value: float) -> str:
    if value >= 10.0:
        return "without bound" if math.isinf(value) else pretty(value, FRACTION)
    return f"{100.0 * value:.{2 if value < 0.1 else 3}g} %"


def _told_apart(least: float, cost: float) -> str:
    """Two costs with the digits that tell them apart."""
    texts = ([pretty(value, DURATION, digits=digits) for value in (least, cost)] for digits in range(2, 17))
    first, second = next((pair for pair in texts if pair[0] != pair[1]), (f"{least!r} s", f"{cost!r} s"))
    return f"{first} in all instead of {second}"


def _words(quantity: Quantity) -> str:
    return {"psf_width": "the width of a point's image"}.get(quantity, "the " + quantity.replace("_", " "))
