"""Audit of the chain's stated error on random cameras; run by hand, writes chain_audit.json beside it.

    python tests/benchmarks/chain_audit.py [--cases 200] [--seed 1]

The true error is that against the same chain with every knob refined far beyond the tolerance; for every twentieth
camera that reference is itself held against plain nested summation on three pixels. On half and a quarter of the nodes
of both apertures the statement must grow with the error, or the run refuse.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from chain_cases import ChainCase, finest, nested_pixels, random_chain_case, run

from tradestudy.errors import TradestudyError
from tradestudy.optics.chain.accuracy import ChainImage
from tradestudy.provenance import machine, versions

RECORD = Path(__file__).with_suffix(".json")
NESTED_EVERY = 20
SHARES = (0.5, 0.25)


def main() -> None:
    """Run every case, print as it goes, write the record."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    begin, cpu = time.perf_counter(), time.process_time()
    rows, drawn, too_large = [], Counter[str](), 0
    while len(rows) < options.cases:
        case = random_chain_case(rng)
        try:
            rows.append(audit(case, nested=len(rows) % NESTED_EVERY == 0))
        except TradestudyError as refusal:  # an honest answer, but nothing to audit: draw another camera
            too_large += 1
            print(f"refused: {refusal}", flush=True)
            continue
        drawn.update((case.relay, f"{case.legs.to_array}–{case.legs.to_detector}"))
        print(f"{len(rows)}: {rows[-1]}", flush=True)
    record = {
        "measured": datetime.now(UTC).date().isoformat(),
        "machine": machine(),
        "versions": versions(),
        "load_average_at_end": [round(v, 2) for v in os.getloadavg()],
        "wall_seconds": round(time.perf_counter() - begin),
        "cpu_seconds": round(time.process_time() - cpu),
        "seed": options.seed,
        "cases": len(rows),
        "refused_at_full_nodes": too_large,
        "drawn": dict(sorted(drawn.items())),
        **summary(rows),
        "rows": rows,
    }
    RECORD.write_text(json.dumps(record, indent=1) + "\n")
    print(json.dumps({k: v for k, v in record.items() if k != "rows"}, indent=1))


def audit(case: ChainCase, *, nested: bool) -> dict[str, object]:
    """Stated and true error of one camera at all, half and a quarter of the nodes."""
    truth = finest(case)
    full = run(case)
    row: dict[str, object] = {
        "relay": case.relay,
        "legs": f"{case.legs.to_array}–{case.legs.to_detector}",
        "tolerance": rounded(case.accuracy.tolerance),
        "stated": rounded(full.numerical_error),
        "true": rounded(true_error(full, truth)),
    }
    for share in SHARES:
        try:
            poor = run(case, node_share=share)
            row[f"at {share} of the nodes"] = [rounded(poor.numerical_error), rounded(true_error(poor, truth))]
        except TradestudyError:
            row[f"at {share} of the nodes"] = "refused"
    if nested:
        order = np.argsort(truth.ravel())[::-1][[0, 4, truth.size // 4]]
        pixels = [(int(i), int(j)) for i, j in zip(*np.unravel_index(order, truth.shape), strict=True)]
        plain = nested_pixels(case, pixels)
        here = np.array([truth[at] for at in pixels])
        row["reference against nested sums"] = rounded(float(np.linalg.norm(here - plain) / np.linalg.norm(plain)))
    return row


def true_error(image: ChainImage, truth: np.ndarray) -> float:
    """Relative L2 over pixels."""
    return float(np.linalg.norm(image.pixels - truth) / np.linalg.norm(truth))


def summary(rows: list[dict[str, object]]) -> dict[str, object]:
    """Coverage and sharpness of the statement, and what happens with too few nodes."""
    stated, true = (np.array([row[name] for row in rows], dtype=float) for name in ("stated", "true"))
    ratio = stated / true
    poor = {}
    for share in SHARES:
        outcomes: Counter[str] = Counter()
        for row, before in zip(rows, true, strict=True):
            match row[f"at {share} of the nodes"]:
                case [float(said), float(is_so)]:
                    # Nodes that were to spare change nothing, and neither need the statement.
                    harmless = is_so < 2 * before
                    outcomes["harmless" if harmless else "confessed" if said >= is_so else "understated"] += 1
                case _:
                    outcomes["refused"] += 1
        poor[f"at {share} of the nodes"] = dict(outcomes)
    return {
        "share_with_true_at_most_stated": round(float(np.mean(ratio >= 1)), 3),
        "median_of_stated_over_true": rounded(float(np.median(ratio))),
        "quantiles_1_5_25_75_95_of_stated_over_true": [
            rounded(v) for v in np.quantile(ratio, [0.01, 0.05, 0.25, 0.75, 0.95])
        ],
        "share_with_true_at_most_tolerance": round(float(np.mean(true <= [row["tolerance"] for row in rows])), 3),
        "fewer_nodes": poor,
    }


def rounded(value: float) -> float:
    """Three digits."""
    return float(f"{value:.3g}")


if __name__ == "__main__":
    main()
