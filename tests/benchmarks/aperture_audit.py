"""Audit of stated errors, run by hand: is the true error below the stated one, and not far below?"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from aperture_cases import random_case, run, true_error

from tradestudy.errors import TradestudyError


def main() -> None:
    """Print coverage and sharpness of the statement over random cases, and what happens with too few nodes."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--cases", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    ratios, starved = [], {0.5: [0, 0, 0], 0.25: [0, 0, 0]}
    for number in range(options.cases):
        case = random_case(rng)
        result = run(case)
        true = true_error(case, result)
        ratios.append(result.error.intensity / true)
        if ratios[-1] < 1:
            print(f"case {number}: stated {result.error.intensity:.2e} < true {true:.2e}")
        for share, (grew, covered, refused) in starved.items():
            try:
                poor = run(case, node_share=share)
            except TradestudyError:
                starved[share] = [grew, covered, refused + 1]
                continue
            truth = true_error(case, poor)
            # With nodes to spare the error does not grow, and neither need the statement.
            grows = poor.error.intensity > result.error.intensity or truth < 3 * true
            starved[share] = [grew + grows, covered + (poor.error.intensity >= truth), refused]
    ratio = np.asarray(ratios)
    print(f"{ratio.size} cases: true ≤ stated in {np.mean(ratio >= 1):.1%}, stated/true median {np.median(ratio):.2f}")
    print("quantiles of stated/true 1, 5, 25, 75, 95 %:", np.quantile(ratio, [0.01, 0.05, 0.25, 0.75, 0.95]).round(2))
    for share, (grew, covered, refused) in starved.items():
        print(f"{share} of the nodes: grew {grew}, still covered {covered}, refused {refused} of {ratio.size}")


if __name__ == "__main__":
    main()
