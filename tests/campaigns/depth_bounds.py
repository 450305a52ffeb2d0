"""Every omission of many random cameras and scenes forced, and the change of depth uncertainty held against its bound.

``python -m tests.campaigns.depth_bounds`` writes the table; a sample of it runs with the tests.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from tests.campaigns.depth_cases import KINDS, base_study, random_study
from tests.campaigns.record import write
from tradestudy.accuracy import Accuracy
from tradestudy.analysis.depth import depth_uncertainty
from tradestudy.analysis.usable import all_met, evaluate_limits
from tradestudy.effects.base import SlotName
from tradestudy.errors import TradestudyError, UnaffordableError
from tradestudy.plan.situations.depth import depth_situations
from tradestudy.study.definition import StudyDefinition

WANTED = 0.01
# Kirchhoff takes its time: it is compared with Fresnel at a few distances.
_KIRCHHOFF_PLACES = 3
_TOGETHER = "all together"


@dataclass(frozen=True, kw_only=True)
class Held:
    """One omission of one camera: what it changed, and what it may change at most; infinite for no bound."""

    case: str
    slot: str
    model: str
    change: float
    bound: float

    @property
    def within(self) -> bool:
        """Whether the promise was kept, to rounding."""
        return self.change <= self.bound * (1.0 + 1e-9) + 1e-12

    @property
    def counts(self) -> bool:
        """Whether the change is large enough for the ratio of bound to change to say something."""
        return self.change > 1e-3 * WANTED


def audit(cases: int, seed: int) -> Iterator[Held]:
    """Omissions of so many random cameras, the kinds in turn."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        bases = {kind: base_study(kind, Path(folder)) for kind in KINDS}
    done = 0
    while done < cases:
        kind = KINDS[done % len(KINDS)]
        try:
            definition = random_study(bases[kind], kind, rng)
        except TradestudyError:  # parts that make no camera
            continue
        held = list(omissions(f"{kind} {done}", definition))
        if held:
            yield from held
            done += 1


_CHEAP: Final = {"kirchhoff": "fresnel", "exact": "linear"}


def omissions(name: str, definition: StudyDefinition, forced: Mapping[SlotName, str] | None = None) -> Iterator[Held]:
    """Every omission of the one camera of a study, and what is chosen for some accuracies; none if it is not usable.

    All beside the models that are forced, if any are. Calibration is linear, so that no draws blur what is changed.
    """
    forced = forced or {}
    (situation,) = depth_situations(definition, forced)
    complete: dict[SlotName, str] = {
        slot.name: next((own for own in ("fresnel", "linear") if own in slot.model_names), slot.model_names[-1])
        for slot in situation.slots
    } | forced
    places = _places(definition, complete)
    if not places.size:
        return
    reference = _uncertainty(definition, complete, places)
    for slot in (one for one in situation.slots if one.name not in forced):
        for model in slot.models[:-1]:
            bound = model.change_of("depth_uncertainty")
            if model.name == "fresnel":
                few = places[np.linspace(0, places.size - 1, _KIRCHHOFF_PLACES).astype(int)]
                exact = _uncertainty(definition, {**complete, slot.name: "kirchhoff"}, few)
                change = _change(_uncertainty(definition, complete, few), exact)
                yield Held(case=name, slot=slot.name, model=model.name, change=change, bound=bound)
                continue
            change = _change(_uncertainty(definition, {**complete, slot.name: model.name}, places), reference)
            yield Held(case=name, slot=slot.name, model=model.name, change=change, bound=bound)
    for wanted in (0.01, 0.05, 0.2):
        try:
            chosen = situation.select(Accuracy.of_all(wanted), forced)
        except UnaffordableError:
            continue
        names = {slot: model.name for slot, model in chosen.chosen.items()}
        cheap = {slot: _CHEAP.get(model, model) for slot, model in names.items()}
        change = _change(_uncertainty(definition, cheap, places), reference)
        bound = chosen.bounds["depth_uncertainty"]
        yield Held(case=name, slot=_TOGETHER, model=f"{wanted:.0%}", change=change, bound=bound)


def _places(definition: StudyDefinition, complete: Mapping[SlotName, str]) -> np.ndarray:
    case = definition.with_models({"one": complete}).case
    met = all_met(evaluate_limits(case.cameras["one"], case.criteria, case.distance), case.distance.shape)
    return case.distance[met]


def _uncertainty(definition: StudyDefinition, models: Mapping[SlotName, str], places: np.ndarray) -> np.ndarray:
    """By noise alone and by all errors; bounds hold for both, however small a part of all errors noise is."""
    camera = definition.with_models({"one": models}).case.cameras["one"]
    return np.stack([depth_uncertainty(camera, places, way) for way in ("noise", "both")])


def _change(value: np.ndarray, reference: np.ndarray) -> float:
    """The largest; infinite where one of the two has lost the far end of depth."""
    known, kept = np.isfinite(reference), np.isfinite(value)
    if np.any(known != kept):
        return float(np.inf)
    return float(np.max(np.abs(value[known] / reference[known] - 1.0), initial=0.0))


def table(found: list[Held]) -> list[tuple[object, ...]]:
    """One row for each model of each slot, one for all models of a slot together, and one for all."""
    rows = []
    for slot in dict.fromkeys(one.slot for one in found):
        own = [one for one in found if one.slot == slot]
        models = list(dict.fromkeys(one.model for one in own))
        rows += [_row(f"{slot}: {model}", [one for one in own if one.model == model]) for model in models]
        if len(models) > 1 and slot != _TOGETHER:
            rows.append(_row(f"all of {slot}", own))
    return [*rows, _row("in all", found)]


def _row(name: str, found: list[Held]) -> tuple[object, ...]:
    """Share within finite bounds; the ratio of bound to change, which is infinite without a bound, where it counts."""
    stated = [one for one in found if np.isfinite(one.bound)]
    within = sum(one.within for one in stated)
    ratios = [one.bound / one.change for one in found if one.counts and np.isfinite(one.change)]
    worst = max((one.change / one.bound for one in stated if one.bound > 0), default=0.0)
    return (
        name,
        len(found),
        len(stated),
        f"{within} ({100 * within / len(stated):.1f} %)" if stated else "—",
        len(ratios),
        f"{np.median(ratios):.3g}" if ratios else "—",
        f"{worst:.3g}" if stated else "—",
    )


def main() -> None:
    """Run the audit and keep its table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    begin = time.monotonic()
    found = list(audit(given.cases, given.seed))
    path = write(
        "depth_bounds",
        f"Omissions of {given.cases} random cameras against their bounds on depth uncertainty, {WANTED:.0%} wanted",
        f"python -m tests.campaigns.depth_bounds --cases {given.cases} --seed {given.seed}",
        (
            "Left out",
            "Cases",
            "Bound stated",
            "Within it",
            "Change > 1e-5",
            "Median bound/change",
            "Largest change/bound",
        ),
        table(found),
    )
    print(path.read_text(encoding="utf-8"))
    for one in sorted(found, key=lambda h: h.change / max(h.bound, 1e-12), reverse=True)[:10]:
        print(one)
    print(f"{time.monotonic() - begin:.0f} s")


if __name__ == "__main__":
    main()
