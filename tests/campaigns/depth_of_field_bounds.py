"""Whether leaving the diffraction spot out moves the ends of what is sharp by no more than its bound says.

    python -m tests.campaigns.depth_of_field_bounds [--cases 400] [--seed 0]

A case is a random camera of one of four kinds and what it calls sharp. The study is run twice for /depth_of_field, with
the spot forced in and forced out, and the ends of every slice are compared. Depth of field is a closed form here; that
of the cameras with one lens is besides held against roots of their blur, found by a bisection of its own.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.optimize import brentq
from scipy.special import j1, jn_zeros

from tests.campaigns import record
from tradestudy.accuracy import Accuracy
from tradestudy.cameras.conventional.design import ConventionalCamera
from tradestudy.cameras.stereo.design import StereoRig
from tradestudy.errors import TradestudyError
from tradestudy.plan.situations.every import depth_of_field_situation
from tradestudy.run.groups.depth_of_field import depth_of_field_group
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.loading import load_definition

STUDIES = Path(__file__).parents[2] / "studies"
KINDS = ("conventional", "stereo", "focused", "unfocused")
CAMERAS = {
    "conventional": "{kind: conventional, title: One lens, lens: {focal_length: 30 mm, f_number: 4}, "
    "sensor: {pixels: [1000, 800], pixel_pitch: 5 um}, focus: {distance: 1 m}}",
    "stereo": f"{{from: {STUDIES}/cameras/stereo-100mm.yaml, stated: null}}",
    "focused": f"{{from: {STUDIES}/cameras/raytrix-r5.yaml}}",
    "unfocused": f"{{from: {STUDIES}/cameras/r5-unfocused.yaml}}",
}
BASE = """\
format: 2
study: audit
title: One camera of the audit
question: How far does the diffraction spot move what it keeps sharp?
cameras:
  one: {camera}
scene:
  distances: {{from: 0.5 m, to: 2 m, points: 3, spacing: log}}
  wavelength: 550 nm
depth_of_field:
  range: [0.5 m, 2 m]
  criteria:
    asked: {{blur: 2 px, diffraction: airy-diameter}}
"""
COUNTS_FROM = 1e-5  # a thousandth of an accuracy of 1 %


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """Bound and change of one case, both relative; how far its ends are from the roots of the blur."""

    number: int
    kind: str
    bound: float
    change: float
    off_roots: float = 0.0

    @property
    def within(self) -> bool:
        """Whether the promise was kept, to rounding."""
        return self.change <= self.bound * (1.0 + 1e-9) + 1e-12

    @property
    def counts(self) -> bool:
        """Whether the ratio of bound to change says something."""
        return math.isfinite(self.bound) and self.change > COUNTS_FROM


def base_study(kind: str, folder: Path) -> StudyDefinition:
    """The study whose values are replaced; read once for each kind."""
    file = folder / f"{kind}.yaml"
    file.write_text(BASE.format(camera=CAMERAS[kind]), encoding="utf-8")
    return load_definition(file, ())


def random_study(base: StudyDefinition, kind: str, rng: np.random.Generator) -> StudyDefinition:
    """Everything drawn wide; the allowed blur from below the spot to far above it."""

    def log(low: float, high: float) -> float:
        return math.exp(rng.uniform(math.log(low), math.log(high)))

    f, f_number = log(4.0, 100.0), log(1.4, 22.0)
    focus = f * log(1.5, 200.0)
    lens = {"conventional": "lens", "stereo": "lenses"}.get(kind, "main_lens")
    values: dict[str, str | float] = {
        f"cameras.one.{lens}.focal_length": f"{f!r} mm",
        f"cameras.one.{lens}.f_number": f_number,
        "cameras.one.sensor.pixel_pitch": f"{log(1.0, 15.0)!r} um",
        "scene.wavelength": f"{rng.uniform(400.0, 950.0)!r} nm",
        "depth_of_field.criteria.asked.blur": f"{log(0.7, 10.0)!r} px",
        "depth_of_field.criteria.asked.diffraction": ("airy-diameter", "fwhm")[int(rng.integers(2))],
    }
    place = {
        "conventional": "focus.distance",
        "stereo": "focus_distance",
        "focused": "focus.total_covering_plane",
        "unfocused": "focus.distance",
    }
    values[f"cameras.one.{place[kind]}"] = f"{focus!r} mm"
    if kind == "stereo":
        values |= {
            "cameras.one.baseline": f"{focus * log(0.02, 0.4)!r} mm",
            "cameras.one.convergence_distance": f"{focus!r} mm",
        }
    return base.with_values(values)


def outcome(number: int, kind: str, definition: StudyDefinition) -> Outcome:
    """Force the spot in and out and compare the ends."""
    asked = definition.file.depth_of_field
    assert asked is not None
    situation = depth_of_field_situation(definition, asked)
    (slot,) = situation.slots
    ends = {}
    for model in ("off", "airy"):
        forced = situation.select(Accuracy.of_all(0.01), {slot.name: model})
        found = depth_of_field_group(definition, asked, forced)
        ends[model] = np.stack([found["slice_near"].values.ravel(), found["slice_far"].values.ravel()])
    return Outcome(
        number=number,
        kind=kind,
        bound=slot.model("off").change_of("depth_of_field"),
        change=_change(ends["off"], ends["airy"]),
        off_roots=_off_the_roots(definition, ends) if kind in ("conventional", "stereo") else 0.0,
    )


def _change(simple: np.ndarray, complete: np.ndarray) -> float:
    """Largest relative change of an end; infinite where one appears or vanishes."""
    if not np.array_equal(np.isfinite(simple), np.isfinite(complete)):
        return math.inf
    both = np.isfinite(simple)
    return float(np.max(np.abs(simple[both] / complete[both] - 1.0), initial=0.0))


def _off_the_roots(definition: StudyDefinition, ends: dict[str, np.ndarray]) -> float:
    """How far both ends, spot in and out, are from where blur and spot just fill what is allowed; in inverse distance.

    Light from a distance a meets behind the lens at 1/(1/f − 1/a); on a sensor at s its cone of base A is
    ``A |s (1/f − 1/a) − 1|`` wide. Inverse distance is bisected on both sides of the focus, over whose own it is given.
    """
    camera, asked = definition.case.all_cameras["one"], definition.file.depth_of_field
    assert isinstance(camera, ConventionalCamera | StereoRig)
    assert asked is not None
    assert camera.focus_distance is not None
    criterion, focus = asked.criteria["asked"], camera.focus_distance
    f, A = camera.lens.focal_length, camera.lens.pupil_diameter
    s = 1.0 / (1.0 / f - 1.0 / focus)
    allowed = criterion.blur * camera.sensor.pixel_pitch
    # Where 2 J₁(x)/x vanishes, and where its square is a half; x = π r/(λ N).
    x = float(
        jn_zeros(1, 1)[0] if criterion.diffraction == "airy-diameter" else brentq(_half_airy, 1.0, 2.0, xtol=1e-15)
    )
    spot = 2.0 * x / math.pi * definition.case.wavelength * s / A
    worst = 0.0
    for model, width in (("off", 0.0), ("airy", spot)):
        if width >= allowed:
            worst = max(worst, 0.0 if np.all(np.isnan(ends[model])) else math.inf)
            continue

        def too_wide(inverse: float, width: float = width) -> bool:
            return math.hypot(A * (s * (1.0 / f - inverse) - 1.0), width) > allowed

        near, far = (1.0 / x if x > 0.0 else math.inf for x in (_root(too_wide, 1.0 / focus, 1.0 / f),
                                                                _root(too_wide, 1.0 / focus, 0.0)))  # fmt: skip
        for own, root in zip(ends[model][:, 0], (near, far), strict=True):
            worst = max(worst, focus * abs(1.0 / own - 1.0 / root))
    return worst


def _half_airy(x: float) -> float:
    return float(2.0 * j1(x) / x) ** 2 - 0.5


def _root(broken: Callable[[float], bool], inside: float, outside: float) -> float:
    """Where a condition breaks between two places; the outer one if it does not."""
    if not broken(outside):
        return outside
    for _ in range(200):
        middle = (inside + outside) / 2.0
        inside, outside = (inside, middle) if broken(middle) else (middle, outside)
    return inside


def audit(cases: int, seed: int) -> list[Outcome]:
    """Outcomes of so many random cameras, the kinds in turn; parts that make no camera are drawn anew."""
    rng = np.random.default_rng(seed)
    found: list[Outcome] = []
    with tempfile.TemporaryDirectory() as folder:
        bases = {kind: base_study(kind, Path(folder)) for kind in KINDS}
        while len(found) < cases:
            kind = KINDS[len(found) % len(KINDS)]
            try:
                found.append(outcome(len(found), kind, random_study(bases[kind], kind, rng)))
            except TradestudyError:
                continue
    return found


def row(name: str, found: list[Outcome]) -> tuple[object, ...]:
    """One row of the record."""
    ratios = [one.bound / one.change for one in found if one.counts]
    within = sum(one.within for one in found)
    return (
        name,
        len(found),
        f"{within} ({100 * within / len(found):.1f} %)",
        sum(math.isinf(one.bound) for one in found),
        len(ratios),
        f"{float(np.median(ratios)):.3g}" if ratios else "—",
        f"{max(ratios):.3g}" if ratios else "—",
        f"{max(one.off_roots for one in found):.1g}" if name in ("conventional", "stereo") else "—",
    )


def main() -> None:
    """Run the cases and write the record."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    found = audit(asked.cases, asked.seed)
    rows = [row("all", found), *(row(kind, [one for one in found if one.kind == kind]) for kind in KINDS)]
    path = record.write(
        "depth_of_field_bounds",
        f"Bound of leaving out the diffraction spot on the ends of the depth of field: {len(found)} random cameras",
        f"python -m tests.campaigns.depth_of_field_bounds --cases {asked.cases} --seed {asked.seed}",
        (
            "Camera", "Cases", "Within the bound", "Bound infinite", "Finite and change > 1e-5", "Median bound/change",
            "Largest bound/change", "Ends off the roots of the blur, in inverse distance",
        ),
        rows,
    )  # fmt: skip
    print(path.read_text(encoding="utf-8"))


if __name__ == "__main__":
    main()
