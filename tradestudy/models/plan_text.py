"""A plan as text for the terminal: one line per problem, or every decision with its numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from tradestudy.accuracy import IN_WORDS, Quantity
from tradestudy.cameras.depth_measurement import CORNERS
from tradestudy.effects import LENSES, MODEL, NAMED, OFF, Change, Evidence, left_out
from tradestudy.imaging.picture import kirchhoff_lattice
from tradestudy.models.choice import Chosen
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.wave_optics import LightSpotPart
from tradestudy.study.varying import calibrations_to_infer, sweep_axes
from tradestudy.units import FRACTION, pretty
from tradestudy.wording import counted, distance, fewest_digits, listed

_SIGNIFICANT: Final = 0.01  # share of the tolerance


def plan_lines(
    problems: Sequence[Chosen], settled: Mapping[str, str], work: Sequence[Work], space: str, *, verbose: bool
) -> Iterator[str]:
    """One line per problem, with all decisions if verbose, and one for the run, with all steps if verbose.

    `settled` states, by name, how questions that leave no choice of models are answered; `space` ends the line for the
    run.
    """
    width = max(map(len, [*(one.name for one in problems), *settled, "run"]))
    for one in problems:
        own = [part.seconds for part in work if part.problem == one.name]
        takes = f"; {magnitude(math.fsum(own))}" if own else ""
        yield f"{one.name:<{width}}  {summary(one)}{takes}"
        if verbose:
            yield from (f"{'':<{width}}    {line}" for line in _decisions(one))
    yield from (f"{name:<{width}}  {how}" for name, how in settled.items())
    yield f"{'run':<{width}}  {_slow(work)}{space}"
    if verbose:
        steps = max(len(part.step) for part in work)
        for part in work:
            name = f"{part.problem}, " if part.problem else ""
            yield f"{'':<{width}}    {part.step:<{steps}}  {magnitude(part.seconds):>7}  {name}{part.amount}"


def _slow(work: Sequence[Work]) -> str:
    """The magnitude of the run, and the step that takes most of it, with the amount of its slowest part."""
    total = math.fsum(part.seconds for part in work)
    seconds: dict[str, float] = {}
    for part in work:
        seconds[part.step] = seconds.get(part.step, 0.0) + part.seconds
    step = max(seconds, key=lambda one: seconds[one])
    slowest = max((part for part in work if part.step == step), key=lambda part: part.seconds)
    of = f" for {slowest.problem}" if slowest.problem else ""
    return f"{magnitude(total)}, mostly {step} ({slowest.amount}{of})"


def summary(one: Chosen) -> str:
    """What is simulated, and the largest omission with its change and the tolerance."""
    return "; ".join(filter(None, (_simulated(one), _left_out(one), _forced(one))))


def _simulated(one: Chosen) -> str:
    """The applied models in words: those of diffraction, calibration and sampling that the problem has."""
    models = one.models
    parts = [MODEL[slot, models[slot]] for slot in LENSES if models.get(slot, OFF) != OFF]
    pictured = "microlens_diffraction" in models and one.reasons.get("defocus_blur", "") in ("", NAMED)
    if not parts:
        parts = ["no diffraction"] if pictured else []
    if one.reasons.get("calibration") and models["calibration"] == OFF and "calibration" not in one.choice.forced:
        parts.append(one.reasons["calibration"])
    elif "calibration" in models:
        drawn = listed([f"“{name}”" for name in one.choice.other_models])
        model = models["calibration"]
        named = "without calibration errors" if model == OFF else MODEL["calibration", model]
        parts.append(named + f" (exact for {drawn})" * bool(drawn))
    if "sampling" in models:
        parts.append(f"sampled to {models['sampling']}")
    if not pictured and "calibration" in models:
        why = one.reasons.get("defocus_blur", "")
        parts.insert(0, f"geometry only ({why})" if why else "geometry only")
        return "; ".join(parts)
    return ", ".join(parts) or "geometry only"


def _left_out(one: Chosen) -> str:
    """The omission with the largest change, and the change due to all omissions with its tolerance."""
    omitted = [
        (change.relative / one.asked[quantity], quantity, change, decision)
        for decision in one.choice.decisions
        if decision.chosen and not decision.forced
        for quantity, change in decision.changes.items()
        if quantity in one.asked and change.relative > 0.0
    ]
    if not omitted:
        return _without_effect(one) or "nothing left out" + _first_refused(one)
    _, quantity, _, decision = max(omitted, key=lambda found: found[0])
    change = one.choice.changes[quantity]  # due to all omissions; can be less than that due to one of them
    significant = {id(found[3]) for found in omitted if found[0] >= _SIGNIFICANT}
    suffix = " and smaller effects together" if len(significant) > 1 else ""
    return (
        f"leaving out {left_out(decision.slot, decision.model)}{suffix} changes the {IN_WORDS[quantity]} by "
        f"{_amount(change, one.asked[quantity])} {_allowance(quantity, change, one)}"
    )


def _without_effect(one: Chosen) -> str:
    """The omissions that change no answer; empty if nothing is left out."""
    complete = one.choice.problem.complete
    omissions = [
        left_out(decision.slot, decision.model)
        for decision in one.choice.decisions
        if decision.chosen and not decision.forced and decision.model != complete[decision.slot]
    ]
    return f"leaving out {listed(omissions)} changes nothing" if omissions else ""


def _first_refused(one: Chosen) -> str:
    """The omission that comes closest to its tolerance without meeting it, which explains why nothing is left out."""
    refused = [
        (max(change.relative / one.asked[quantity] for quantity, change in asked.items()), decision, asked)
        for decision in one.choice.decisions
        if not decision.chosen and decision.slot not in one.choice.forced and not one.reasons.get(decision.slot)
        if (asked := {quantity: change for quantity, change in decision.changes.items() if quantity in one.asked})
    ]
    refused = [found for found in refused if found[0] > 1.0]
    if not refused:
        return ""
    _, decision, asked = min(reversed(refused), key=lambda found: found[0])  # of equals, the most complete model
    quantity, change = max(asked.items(), key=lambda item: item[1].relative / one.asked[item[0]])
    omission = left_out(decision.slot, decision.model)
    if math.isinf(change.relative):
        allowed = pretty(one.asked[quantity], FRACTION)
        return (
            f", because it is unknown by how much leaving out {omission} would change the {IN_WORDS[quantity]} "
            f"({allowed} allowed)"
        )
    return (
        f", because leaving out {omission} would change the {IN_WORDS[quantity]} by "
        f"{_amount(change, one.asked[quantity])} {_allowance(quantity, change, one)}"
    )


def _allowance(quantity: Quantity, change: Change, one: Chosen) -> str:
    """The evidence of a change, if it is a trial, and the tolerance, in brackets."""
    how = f"{_tried(quantity)}; " if change.evidence == "trial" else ""
    return f"({how}{pretty(one.asked[quantity], FRACTION)} allowed)"


def _forced(one: Chosen) -> str:
    if not one.by_forcing:
        return ""
    quantity, change = max(
        ((q, c) for q, c in one.by_forcing.items() if q in one.asked), key=lambda found: found[1].relative
    )
    if change.relative == 0.0:
        return ""
    named = ", ".join(
        f"{slot.replace('_', ' ')}: {model}" for slot, model in one.choice.forced.items() if slot in one.models
    )
    more, share = "more than" if change.relative > one.asked[quantity] else "within", _share(quantity, change, one)
    return (
        f"{named}, as the study requires, changes the {IN_WORDS[quantity]} by {share}, {more} the "
        f"{pretty(one.asked[quantity], FRACTION)} allowed"
    )


def _decisions(one: Chosen) -> Iterator[str]:
    """Every model of every effect with its change, or the reason why the effect has only one model."""
    for quantity in dict.fromkeys([*one.asked, *one.choice.changes]):
        share = _share(quantity, one.choice.changes[quantity], one)
        limit = f"{pretty(one.asked[quantity], FRACTION)} allowed" if quantity in one.asked else "no tolerance applies"
        yield f"all omissions together change the {IN_WORDS[quantity]} by {share}; {limit}"
    stated: set[str] = set()
    yield "● used, ○ not used; each change is relative to the most complete model of the effect"
    for decision in one.choice.decisions:
        mark, name = "●" if decision.chosen else "○", f"{decision.slot.replace('_', ' ')}: {decision.model}"
        if reason := one.reasons.get(decision.slot):
            once = "" if reason in stated else f"  {reason}"
            stated.add(reason)
            yield f"{mark} {name}{once}"
            continue
        asked = ((quantity, change) for quantity, change in decision.changes.items() if quantity in one.asked)
        changed = ", ".join(f"the {IN_WORDS[of]} by {_share(of, change, one)}" for of, change in asked)
        yield f"{mark} {name}" + f"  changes {changed}" * bool(changed)


def _share(quantity: Quantity, change: Change, one: Chosen) -> str:
    """A change and its evidence: "0.22 %", "up to about 1.3 %", "about 0.02 % (trial at a few distances)"."""
    if math.isinf(change.relative) or change.relative == 0.0:
        return _amount(change)
    amount = _amount(change, one.asked.get(quantity, math.nan))
    at = "" if math.isnan(change.at) else f" at {distance(change.at)}"
    return f"{amount}{at}{f' ({_tried(quantity)})' if change.evidence == 'trial' else ''}"


def _tried(quantity: Quantity) -> str:
    return f"trial at a few {'places' if quantity == 'pixel_intensity' else 'distances'}"


def _amount(change: Change, tolerance: float = math.nan) -> str:
    """The size of a change, with enough digits to tell it from its tolerance."""
    if math.isinf(change.relative):
        return "an unknown amount"
    if change.relative == 0.0:
        return "0 %"
    known: dict[Evidence, str] = {"computed": "", "rule": "up to about ", "trial": "about "}
    size, allowed = pretty(change.relative, FRACTION, digits=2), pretty(tolerance, FRACTION)
    if size == allowed:
        digits = fewest_digits(lambda digits: pretty(change.relative, FRACTION, digits=digits) != allowed)
        size = pretty(change.relative, FRACTION, digits=digits)
    return f"{known[change.evidence]}{size}"


# On one core of a laptop; good to a factor of about five, which suffices to tell seconds from minutes and hours.
SECONDS: Final[Mapping[str, float]] = {
    "calibration": 5.0,
    "depth at a distance, linear": 2e-4,
    "depth at a distance, exact": 3e-3,
    "Kirchhoff diffraction at a defocus": 0.2,
    "verdict under a reading": 0.1,
    "combination of errors": 0.02,
    "sensitivity of a camera": 0.5,
    "question": 1.0,
    "rendered pixel": 4e-6,
    "rendered pixel by waves": 8e-6,
    "depth of a pixel": 5e-6,
    "rendered plane": 4.0,
    "pair of point spreads, on axis": 0.05,
    "pair of point spreads, off axis": 1.0,
    "point spread": 0.12,
    "microlens lit to 1 %": 0.6,
    "hard case": 0.015,
    "report": 2.0,
}
_AT_ONCE: Final = 2.0  # seconds
_GROWTH_WITH_ACCURACY: Final = 0.75  # exponent of the time of a light spot in the inverse tolerance


@dataclass(frozen=True, kw_only=True)
class Work:
    """A part of a run's work.

    Parameters
    ----------
    step
        Name of the step in the run's progress.
    amount
        The amount of work, in words.
    seconds
        Time on one core, from `SECONDS`.
    problem
        Name of the problem of the plan that it solves; empty if it belongs to the whole study.
    """

    step: str
    amount: str
    seconds: float
    problem: str = ""


def magnitude(seconds: float) -> str:
    """A time by order of magnitude: "at once", "seconds", "minutes" or "hours"."""
    if seconds < _AT_ONCE:
        return "at once"
    return "seconds" if seconds < 60.0 else "minutes" if seconds < 3600.0 else "hours"


def work_of(definition: StudyDefinition) -> tuple[Work, ...]:
    """All work of a run, in the order of its steps, for a study with its models applied."""
    return (
        *_depth(definition),
        *_pictures(definition),
        *_wave_optics(definition),
        *_answers(definition),
        Work(step="report", amount="figures, HTML, PDF", seconds=SECONDS["report"]),
    )


def _work(step: str, unit: str, count: float, amount: str, problem: str = "") -> Work:
    return Work(step=step, amount=amount, seconds=count * SECONDS[unit], problem=problem)


def _depth(definition: StudyDefinition) -> Iterator[Work]:
    """Calibrations, tables of depth, and the sensitivity of each camera."""
    file, case = definition.file, definition.case
    if asked := calibrations_to_infer(definition):
        yield _work("calibration", "calibration", len(asked), counted(len(asked), "posterior"))
    if lattice := kirchhoff_lattice(case.cameras.values(), case.distance):
        amount = f"Kirchhoff diffraction at {counted(len(lattice), 'value')} of defocus"
        yield _work("pictures", "Kirchhoff diffraction at a defocus", len(lattice), amount)
    axes = sweep_axes(definition)
    places = len(CORNERS) * len(file.propagation.field_places)
    for name, camera in case.cameras.items():
        exact = "exact" if camera.propagation.model == "exact" else "linear"
        designs = math.prod(len(axis.values) for axis in axes if axis.path.partition(".")[0] == name)
        for step, count, what in (
            ("depth", designs, "design"),
            ("depth off the axis", places, "place"),
        ):
            if count:
                amount = f"{counted(count, what)} at {counted(case.distance.size, 'distance')}"
                unit = f"depth at a distance, {exact}"
                yield _work(step, unit, count * case.distance.size, amount, name)
    if file.sensitivity is not None:
        fields = file.propagation.axis_and_places
        count = len(case.cameras) * len(fields)
        amount = f"{counted(len(case.cameras), 'camera')} at {counted(len(fields), 'field position')}"
        yield _work("sensitivity", "sensitivity of a camera", count, amount)


def _answers(definition: StudyDefinition) -> Iterator[Work]:
    """Verdicts under every reading, the value of information, and inverse questions."""
    file = definition.file
    if file.decision is not None:
        verdicts = 1 + len(definition.readings)
        amount = f"{counted(verdicts, 'verdict')} on the main pair"
        yield _work("decision", "verdict under a reading", verdicts, amount)
    if (answers := len(file.claims) * (1 + len(definition.readings)) + len(file.requirements)) > 0:
        amount = counted(answers, "verdict")
        yield _work("claims", "verdict under a reading", answers, amount)
    if (part := file.value_of_information) is not None:
        amount = counted(part.draws, "combination")
        yield _work("value of information", "combination of errors", part.draws, amount)
    if file.solve:
        yield _work("inverse questions", "question", len(file.solve), counted(len(file.solve), "question"))


def _pictures(definition: StudyDefinition) -> Iterator[Work]:
    """Rendered scenes and planes, and the depth that is read in them."""
    file = definition.file
    if file.scene is not None and file.scene.image is not None:
        from tradestudy.models.rendered_scene import set_up
        from tradestudy.models.scene_pictures import TRIAL_TEXTURE, name_of

        _, cameras = set_up(definition, rig="as-designed", texture_side=TRIAL_TEXTURE)
        for taken in cameras:
            name = name_of(taken.name)
            pixels = sum(one.sensor.columns * one.sensor.rows for one in taken.exposures)
            by_waves = definition.models.get(name, {}).get("main_lens_diffraction", OFF) != OFF
            amount = f"{pixels / 1e6:.3g} million pixels"
            yield _work("rendering", "rendered pixel" + " by waves" * by_waves, pixels, amount, name)
            if file.scene.image.depth_maps:
                yield _work("depth maps", "depth of a pixel", pixels, amount, name)
    if (loop := file.depth_loop) is not None:
        cameras_of_loop = loop.cameras or definition.case.cameras
        varied = max(1, len(loop.contrasts or ())) * max(1, len(loop.electrons or ()))
        planes = len(cameras_of_loop) * len(loop.distances) * varied
        yield _work("depth loop", "rendered plane", planes, counted(planes, "plane"))


def _wave_optics(definition: StudyDefinition) -> Iterator[Work]:
    """Comparisons of Fresnel with Kirchhoff, light spots, images of points, and hard cases."""
    from tradestudy.study.schema.wave_optics import listed

    file = definition.file
    if (fresnel := file.fresnel_validity) is not None:
        numbers, elements = len(listed(fresnel.f_numbers)), len(fresnel.elements)
        limits = len(fresnel.lens_phases) * (1 + 2 * len(fresnel.windows))
        pairs = elements * len(fresnel.wavelengths) * (numbers + limits)
        step = "Fresnel against Kirchhoff, on axis"
        yield _work(step, "pair of point spreads, on axis", pairs, f"about {counted(pairs, 'pair')} of point spreads")
        if fresnel.off_axis is not None:
            pairs = elements * (numbers + 1)
            step = "Fresnel against Kirchhoff, off axis"
            yield _work(step, "pair of point spreads, off axis", pairs, f"{counted(pairs, 'pair')} of point spreads")
    if file.light_spot is not None:
        yield _light_spot(file.light_spot)
    if (part := file.point_spread) is not None:
        varied = (listed(part.f_numbers), part.wavelengths, part.field_angles, part.defocus)
        count = 2 * len(part.elements) * sum(map(len, varied))
        yield _work("point spread", "point spread", count, counted(count, "point spread"))
    if file.hard_cases is not None:
        from tradestudy.verification import all_families

        count = sum(len(family.cases) for family in all_families() if family.name in file.hard_cases.families)
        yield _work("hard cases", "hard case", count, counted(count, "case"))


def _light_spot(part: LightSpotPart) -> Work:
    """Pictures by the compared methods other than rays, or else by the chosen models."""
    from tradestudy.models.light_spot import NAME
    from tradestudy.models.spot_images import RAYS

    pictures = max(1, sum(method not in RAYS for method in part.methods))
    amount = f"{counted(pictures, 'picture')} of {counted(_microlenses(part), 'microlens', 'microlenses')}"
    seconds = pictures * picture_seconds(part, part.tolerance)
    return Work(step="image of the spot", amount=amount, seconds=seconds, problem=NAME)


def picture_seconds(part: LightSpotPart, tolerance: float) -> float:
    """Time of one picture of a light spot by waves, to a tolerance."""
    accuracy = (0.01 / tolerance) ** _GROWTH_WITH_ACCURACY
    units = len(part.lines) * _microlenses(part) * accuracy
    return float(units * SECONDS["microlens lit to 1 %"])


def _microlenses(part: LightSpotPart) -> int:
    """How many microlenses lie in front of a pixel."""
    from tradestudy.models.spot_images import light_path
    from tradestudy.optics.chain.image import nearest_microlens

    return np.unique(nearest_microlens(light_path(part))).size
