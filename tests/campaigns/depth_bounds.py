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

import numpy as np

from tests.campaigns.depth_cases import KINDS, base_study, random_study
from tests.campaigns.record import write
from tradestudy.accuracy import Accuracy
from tradestudy.effects.base import SlotName
from tradestudy.errors import TradestudyError, UnaffordableError
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.depth import depth_uncertainty
from tradestudy.study.situations.depth import depth_situations
from tradestudy.study.usable import all_met, evaluate_limits

WANTED = 0.01
# Kirchhoff takes its time: it is compared with Fresnel at a few distances of some of the cases.
_KIRCHHOFF_EVERY, _KIRCHHOFF_PLACES = 5, 3


@dataclass(frozen=True, kw_only=True)
class Held:
    """One omission of one camera: what it changed, and what it may change at most."""

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
        return self.change > 1e-3 * WANTED and np.isfinite(self.bound)


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
        held = list(_held(f"{kind} {done}", definition, kirchhoff=done % _KIRCHHOFF_EVERY == 0))
        if held:
            yield from held
            done += 1


def _held(name: str, definition: StudyDefinition, *, kirchhoff: bool) -> Iterator[Held]:
    (situation,) = depth_situations(definition, {})
    complete: dict[SlotName, str] = {
        slot.name: "fresnel" if "fresnel" in slot.model_names else slot.model_names[-1] for slot in situation.slots
    }
    places = _places(definition, complete)
    if not places.size:
        return
    reference = _uncertainty(definition, complete, places)
    for slot in situation.slots:
        for model in slot.models[:-1]:
            bound = model.change_of("depth_uncertainty")
            if model.name == "fresnel":
                if kirchhoff:
                    few = places[np.linspace(0, places.size - 1, _KIRCHHOFF_PLACES).astype(int)]
                    exact = _uncertainty(definition, {**complete, slot.name: "kirchhoff"}, few)
                    change = _change(_uncertainty(definition, complete, few), exact)
                    yield Held(case=name, slot=slot.name, model=model.name, change=change, bound=bound)
                continue
            if np.isinf(bound):
                continue
            change = _change(_uncertainty(definition, {**complete, slot.name: model.name}, places), reference)
            yield Held(case=name, slot=slot.name, model=model.name, change=change, bound=bound)
    for wanted in (0.01, 0.05, 0.2):
        try:
            chosen = situation.select(Accuracy.of_all(wanted), {})
        except UnaffordableError:
            continue
        names = {slot: model.name for slot, model in chosen.chosen.items()}
        cheap = {slot: "fresnel" if model == "kirchhoff" else model for slot, model in names.items()}
        change = _change(_uncertainty(definition, cheap, places), reference)
        bound = chosen.bounds["depth_uncertainty"]
        yield Held(case=name, slot="all together", model=f"{wanted:.0%}", change=change, bound=bound)


def _places(definition: StudyDefinition, complete: Mapping[SlotName, str]) -> np.ndarray:
    case = definition.with_models({"one": complete}).case
    met = all_met(evaluate_limits(case.cameras["one"], case.criteria, case.distance), case.distance.shape)
    return case.distance[met]


def _uncertainty(definition: StudyDefinition, models: Mapping[SlotName, str], places: np.ndarray) -> np.ndarray:
    return depth_uncertainty(definition.with_models({"one": models}).case.cameras["one"], places)


def _change(value: np.ndarray, reference: np.ndarray) -> float:
    both = np.isfinite(value) & np.isfinite(reference)
    return float(np.max(np.abs(value[both] / reference[both] - 1.0), initial=0.0))


def table(found: list[Held]) -> list[list[object]]:
    """Per slot and model: cases, share within the bound, median of bound over change, the largest of change/bound."""
    rows: list[list[object]] = []
    for key in dict.fromkeys((one.slot, one.model) for one in found):
        members = [one for one in found if (one.slot, one.model) == key]
        ratios = [one.bound / one.change for one in members if one.counts]
        worst = max((one.change / one.bound for one in members if one.bound > 0), default=0.0)
        rows.append(
            [
                key[0],
                key[1],
                len(members),
                f"{100 * np.mean([one.within for one in members]):.1f} %",
                len(ratios),
                f"{np.median(ratios):.3g}" if ratios else "—",
                f"{worst:.3g}",
            ]
        )
    return rows


def main() -> None:
    """Run the audit and keep its table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    begin = time.monotonic()
    found = list(audit(given.cases, given.seed))
    rows = table(found)
    within = np.mean([one.within for one in found])
    ratios = [one.bound / one.change for one in found if one.counts]
    rows.append(["in all", "", len(found), f"{100 * within:.2f} %", len(ratios), f"{np.median(ratios):.3g}", ""])
    path = write(
        "depth_bounds",
        f"Omissions of {given.cases} random cameras against their bounds on depth uncertainty, {WANTED:.0%} wanted",
        f"python -m tests.campaigns.depth_bounds --cases {given.cases} --seed {given.seed}",
        ("Effect", "Model", "Cases", "Within", "That count", "Median bound/change", "Largest change/bound"),
        rows,
    )
    print(path.read_text(encoding="utf-8"))
    for one in sorted(found, key=lambda h: h.change / max(h.bound, 1e-12), reverse=True)[:10]:
        print(one)
    print(f"{time.monotonic() - begin:.0f} s")


if __name__ == "__main__":
    main()
