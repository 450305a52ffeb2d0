"""Whether Fresnel's law changes the width of a point's image by no more than its bound says.

    python -m tests.campaigns.width_bounds [--cases 300] [--seed 0]

A case is a random lens, a random point before it, on or off axis, in focus or not, and a wavelength. Both laws are
computed; the width is the radius about the chief ray that holds half the light of the pupil.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import numpy as np

from tests.campaigns import record
from tradestudy.analysis.point_spreads import LensAndPoint, point_spread_of
from tradestudy.effects.point_images import diffraction_of_points
from tradestudy.errors import TradestudyError
from tradestudy.optics.point_spread import encircled_energy_radius
from tradestudy.plan.situations.point_spread import point_image

PHASES = ("parabolic", "stigmatic", "perfect")
WINDOW = 12.0  # Airy radii; a wider image is refused and counted
TOLERANCE = 1e-4
COUNTS_FROM = 1e-5  # a thousandth of an accuracy of 1 %


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Bound and change of one case, both relative."""

    number: int
    lens_phase: str
    bound: float
    change: float


def random_case(rng: np.random.Generator) -> LensAndPoint:
    """Everything drawn wide; aberration from far below to far above the diffraction radius."""
    focal_length = math.exp(rng.uniform(math.log(0.3e-3), math.log(50e-3)))
    return LensAndPoint(
        focal_length=focal_length,
        object_distance=focal_length * (1.0 + math.exp(rng.uniform(math.log(0.3), math.log(50.0)))),
        f_number=math.exp(rng.uniform(math.log(1.8), math.log(22.0))),
        wavelength=rng.uniform(0.4e-6, 0.95e-6),
        lens_phase=PHASES[int(rng.integers(3))],
        field_angle=0.0 if rng.random() < 0.3 else rng.uniform(0.0, 0.06),
        defocus_waves=0.0 if rng.random() < 0.3 else rng.uniform(-1.5, 1.5),
    )


def half_energy_radius(case: LensAndPoint, method: str) -> float:
    """Radius that holds half the light of the pupil [m]."""
    assert method in ("fresnel", "kirchhoff")
    psf = point_spread_of(case, method=method, window=WINDOW, tolerance=TOLERANCE)
    return float(encircled_energy_radius(psf, centre=case.chief_point, share=0.5).value)


def outcome(number: int, seed: int) -> Outcome:
    """Force the dearer law and compare."""
    case = random_case(np.random.default_rng([seed, number]))
    bound = diffraction_of_points([point_image(case)]).model("fresnel").change_of("psf_width")
    simple, complete = (half_energy_radius(case, method) for method in ("fresnel", "kirchhoff"))
    return Outcome(number=number, lens_phase=case.lens_phase, bound=bound, change=abs(simple / complete - 1.0))


def row(name: str, found: list[Outcome]) -> tuple[object, ...]:
    """One row of the record."""
    ratios = sorted((one.bound / one.change, one.number) for one in found if one.change > COUNTS_FROM)
    within = sum(one.change <= one.bound for one in found)
    values = [ratio for ratio, _ in ratios]
    return (
        name,
        len(found),
        f"{within} ({100 * within / len(found):.1f} %)",
        len(ratios),
        f"{float(np.median(values)):.1f}",
        f"{float(np.quantile(values, 0.9)):.0f}",
        ", ".join(f"{ratio:.2g} ({number})" for ratio, number in ratios[:3]),
    )


def main() -> None:
    """Run the cases and write the record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    found: list[Outcome] = []
    refused = 0
    for number in range(asked.cases):
        try:
            found.append(outcome(number, asked.seed))
        except TradestudyError:
            refused += 1
        if (number + 1) % 25 == 0:
            print(f"{number + 1} of {asked.cases}", flush=True)
    rows = [row("all", found)]
    rows += [row(phase, [one for one in found if one.lens_phase == phase]) for phase in PHASES]
    record.write(
        "width_bounds",
        f"Bound of Fresnel's law on the width of a point's image: {len(found)} random lenses and points, "
        f"{refused} wider than {WINDOW:g} Airy radii or beyond infinity",
        f"python -m tests.campaigns.width_bounds --cases {asked.cases} --seed {asked.seed}",
        (
            "Lens phase", "Cases", "Within the bound", "Change > 1e-5", "Median bound/change", "90 % quantile",
            "Least ratios (case)",
        ),
        rows,
    )  # fmt: skip


if __name__ == "__main__":
    main()
