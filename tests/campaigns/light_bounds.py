"""Whether leaving an effect out of a light picture changes it by no more than its bound says.

    python -m tests.campaigns.light_bounds [--cases 150] [--again]

What each effect changes is measured once and kept in `light_changes.json`; bounds are computed anew every time. A
case is a random light path with a random source (`light_cases`), drawn from its number alone.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from tests.campaigns import record
from tests.campaigns.light_cases import RAYS, bounds_of, changes_of, random_case
from tradestudy.errors import TradestudyError

CHANGES = Path(__file__).parent / "light_changes.json"
TOLERANCE = 0.002  # of both pictures; at 2 % what they do not share reached 0.5 %
COUNTS_FROM = 1e-5  # a thousandth of an accuracy of 1 %

DIFFRACTION = ("main_lens_diffraction", "microlens_diffraction")

Changes = dict[str, dict[str, float]]


def measured() -> tuple[Changes, dict[str, str]]:
    """Changes of each case, and the cases that the computation refused, with its words."""
    if not CHANGES.exists():
        return {}, {}
    kept = json.loads(CHANGES.read_text(encoding="utf-8"))
    return kept["changes"], kept["refused"]


def measure(cases: int) -> None:
    """Measure the cases that are missing, and effects that are missing in a case, keeping each case as it is done."""
    changes, refused = measured()
    for index in range(cases):
        key, case = str(index), random_case(np.random.default_rng([0, index]))
        missing = bounds_of(case).keys() - changes.get(key, {}).keys()
        if key in refused or not missing:
            continue
        try:
            found = changes_of(case, TOLERANCE, sorted(missing))
            changes[key] = changes.get(key, {}) | {name: float(f"{value:.4g}") for name, value in found.items()}
        except TradestudyError as error:
            refused[key] = str(error)
        keep(changes, refused)
        print(f"{index + 1} of {cases}", flush=True)


def keep(changes: Changes, refused: Mapping[str, str]) -> None:
    """Write what was measured."""
    content = {"tolerance": TOLERANCE, "changes": changes, "refused": refused}
    CHANGES.write_text(json.dumps(content, indent=0, sort_keys=True) + "\n", encoding="utf-8")


Found = tuple[int, float, float]  # number of a case, bound, change


def by_effect(changes: Changes) -> dict[str, list[Found]]:
    """Bounds, computed anew, beside changes."""
    pairs: dict[str, list[Found]] = {}
    for key, one in changes.items():
        bounds = bounds_of(random_case(np.random.default_rng([0, int(key)])))
        for name, change in one.items():
            pairs.setdefault(name, []).append((int(key), bounds[name], change))
    return pairs


def by_slot(pairs: Mapping[str, list[Found]]) -> dict[str, list[Found]]:
    """All models of each slot together; rays on both legs are "off" of both slots of diffraction."""
    slots: dict[str, list[Found]] = {}
    for name, found in pairs.items():
        for slot in DIFFRACTION if name == RAYS else (name.partition(":")[0],):
            slots.setdefault(slot, []).extend(found)
    return slots


def ratios(found: list[Found]) -> list[float]:
    """Of the bounds that are stated over the changes that count."""
    return [bound / change for _, bound, change in found if math.isfinite(bound) and change > COUNTS_FROM]


def summary(changes: Changes) -> list[tuple[object, ...]]:
    """One row for each effect, and one for all models of a slot together."""
    pairs = by_effect(changes)
    rows = [_row(name, found) for name, found in pairs.items()]
    return rows + [_row(f"all of {slot}", found) for slot, found in by_slot(pairs).items() if slot in DIFFRACTION]


def _row(name: str, found: list[Found]) -> tuple[object, ...]:
    stated = [one for one in found if math.isfinite(one[1])]
    within = [one for one in stated if one[2] <= one[1]]
    counted = ratios(found)
    worst = sorted((bound / change, number) for number, bound, change in stated if change > COUNTS_FROM)[:3]
    return (
        name,
        len(found),
        len(stated),
        f"{len(within)} ({100 * len(within) / len(stated):.1f} %)",
        len(counted),
        f"{float(np.median(counted)):.1f}",
        f"{float(np.quantile(counted, 0.9)):.0f}",
        ", ".join(f"{ratio:.2g} ({number})" for ratio, number in worst),
    )


def main() -> None:
    """Measure what is missing and write the record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=0, help="measure up to so many; 0: those that are kept")
    parser.add_argument("--again", action="store_true", help="forget what is kept")
    asked = parser.parse_args()
    if asked.again:
        CHANGES.unlink(missing_ok=True)
    measure(asked.cases)
    changes, refused = measured()
    record.write(
        "light_bounds",
        f"Bounds of light pictures against what leaving effects out changes: {len(changes)} random light paths, "
        f"{len(refused)} refused",
        "python -m tests.campaigns.light_bounds",
        (
            "Left out", "Cases", "Bound stated", "Within it", "Change > 1e-5", "Median bound/change", "90 % quantile",
            "Least ratios (case)",
        ),
        summary(changes),
    )  # fmt: skip


if __name__ == "__main__":
    main()
