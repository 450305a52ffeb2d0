"""Plan a study: what a run simulates, what it leaves out and why, and which steps are slow."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from tradestudy.accuracy import IN_WORDS, Accuracy, Quantity
from tradestudy.depth.usable import LIMIT_NAMES
from tradestudy.effects import LENSES, MODEL, OFF, Models, left_out
from tradestudy.errors import UnaffordableError
from tradestudy.models.choice import choose_models, refuse_chosen_spot
from tradestudy.models.problem import NAMED, Change, Choice, Evidence
from tradestudy.models.slow_steps import Work, magnitude, work_of
from tradestudy.results import GROUPS
from tradestudy.study.prepared import Choices, PreparedStudy
from tradestudy.study.varying import sweep_axes
from tradestudy.units import DATA, DURATION, FRACTION, pretty
from tradestudy.wording import distance, fewest_digits, listed

TIME_REMEDY: Final = "raise accuracy.time_limit, loosen the tolerance, or ask for less"
_PARTS: Final = 4  # groups of errors of a camera, each with its share of the variance
_IN_MEMORY: Final = 3.5  # peak of a run relative to the results, as measured for 2652 designs
_WORTH_NAMING: Final = 8e9  # bit
_CERTAINLY_TOO_LONG: Final = 10.0  # times the limit; the table of seconds is not more precise
_SIGNIFICANT: Final = 0.01  # share of the tolerance


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The decisions of a study.

    Parameters
    ----------
    study
        The study, with the chosen models applied.
    accuracy
        Its tolerances and time limit.
    problems
        Every problem of the study with its models.
    work
        All work of the run, in the order of its steps.
    """

    study: PreparedStudy
    accuracy: Accuracy
    problems: Sequence[Choice]
    work: tuple[Work, ...]

    def models(self, problem: str) -> Models:
        """The models applied to a problem, by effect."""
        return next(choice.models for choice in self.problems if choice.name == problem)

    def text(self, *, verbose: bool = False) -> str:
        """The plan as text: one line per problem and one for the run; with every decision if verbose."""
        settled, space = dict(_settled(self.study)), _space(self.study)
        return "\n".join(plan_lines(self.problems, settled, self.work, space, verbose=verbose))

    def __repr__(self) -> str:
        return self.text()


def _settled(study: PreparedStudy) -> Iterator[tuple[str, str]]:
    """Questions that compare given models, which leaves no choice: their names, and how they are answered."""
    file = study.file
    if (fresnel := file.fresnel_validity) is not None:
        error = pretty(fresnel.tolerance, FRACTION, digits=2)
        yield (
            "fresnel-validity",
            f"Fresnel and Kirchhoff diffraction, because the study compares them; both to {error} of the intensity, "
            "nothing left out",
        )
    if file.hard_cases is not None:
        yield (
            "hard-cases",
            "textbook formulas and the program's, each against a reference, because the study compares them",
        )


def _space(study: PreparedStudy) -> str:
    """Memory and disk space that a run takes, in words; empty up to 1 GB of memory."""
    results = size_of_depth(study)
    memory = _IN_MEMORY * results
    if memory <= _WORTH_NAMING:
        return ""
    return f"; about {pretty(memory, DATA, digits=2)} of memory, {pretty(results, DATA, digits=2)} on disk"


def size_of_depth(study: PreparedStudy) -> float:
    """Size of the results over distance and all designs of a study [bit], to about a quarter."""
    case = study.case
    quantiles = [len(camera.propagation.probabilities) for camera in case.cameras.values()]
    sizes = {
        "camera": len(case.cameras), "distance": case.distance.size, "interval": 1, "side": 2, "error_source": 3,
        "quantile": max(quantiles, default=0), "part": _PARTS, "limit": len(LIMIT_NAMES),
    }  # fmt: skip
    numbers = sum(math.prod(sizes[dim] for dim in variable.dims) for variable in GROUPS["depth"].values())
    return 64.0 * numbers * math.prod(len(axis.values) for axis in sweep_axes(study))


def plan_of(study: PreparedStudy) -> Plan:
    """Choose the models of every problem of a study and name the slow steps of its run.

    Raises
    ------
    UnaffordableError
        If even the most complete models exceed a tolerance, or the run would take far longer than its time
        limit.
    StudyError
        If the study forces a model that none of its problems has, or weighs a criterion that is not a number.
    """
    accuracy = study.file.accuracy.asked()
    problems = choose_models(study)
    other_models: dict[str, dict[str, Models]] = {}
    for choice in problems:
        for reading, models in choice.other_models.items():
            other_models.setdefault(reading, {})[choice.name] = models
    choices = Choices(models={choice.name: choice.models for choice in problems}, other_models=other_models)
    applied = replace(study, choices=choices)
    plan = Plan(study=applied, accuracy=accuracy, problems=problems, work=work_of(applied))
    refuse_chosen_spot(study, problems)
    seconds = math.fsum(part.seconds for part in plan.work)
    if seconds > _CERTAINLY_TOO_LONG * accuracy.time_limit:
        raise UnaffordableError(
            "the run would take far longer than its time limit",
            value=magnitude(seconds),
            limit=pretty(accuracy.time_limit, DURATION),
            remedy=TIME_REMEDY,
        )
    return plan


def plan_lines(
    problems: Sequence[Choice], settled: Mapping[str, str], work: Sequence[Work], space: str, *, verbose: bool
) -> Iterator[str]:
    """One line per problem, with all decisions if verbose, and one for the run, with all steps if verbose.

    `settled` states, by name, how questions that leave no choice of models are answered; `space` ends the line for the
    run.
    """
    width = max(map(len, [*(choice.name for choice in problems), *settled, "run"]))
    for choice in problems:
        seconds = [part.seconds for part in work if part.problem == choice.name]
        takes = f"; {magnitude(math.fsum(seconds))}" if seconds else ""
        yield f"{choice.name:<{width}}  {summary(choice)}{takes}"
        if verbose:
            yield from (f"{'':<{width}}    {line}" for line in _decisions(choice))
    yield from (f"{name:<{width}}  {how}" for name, how in settled.items())
    yield f"{'run':<{width}}  {_slow(work)}{space}"
    if verbose:
        steps = max(len(part.step) for part in work)
        for part in work:
            problem = f"{part.problem}, " if part.problem else ""
            yield f"{'':<{width}}    {part.step:<{steps}}  {magnitude(part.seconds):>7}  {problem}{part.amount}"


def _slow(work: Sequence[Work]) -> str:
    """The magnitude of the run, and the step that takes most of it, with the amount of its slowest part."""
    total = math.fsum(part.seconds for part in work)
    seconds: dict[str, float] = {}
    for part in work:
        seconds[part.step] = seconds.get(part.step, 0.0) + part.seconds
    step = max(seconds, key=lambda name: seconds[name])
    slowest = max((part for part in work if part.step == step), key=lambda part: part.seconds)
    for_problem = f" for {slowest.problem}" if slowest.problem else ""
    return f"{magnitude(total)}, mostly {step} ({slowest.amount}{for_problem})"


def summary(choice: Choice) -> str:
    """What is simulated, and the largest omission with its change and the tolerance."""
    return "; ".join(filter(None, (_simulated(choice), _left_out(choice), _forced(choice))))


def _simulated(choice: Choice) -> str:
    """The applied models in words: those of diffraction, calibration and sampling that the problem has."""
    models, reasons = choice.models, choice.problem.reasons
    parts = [MODEL[slot, models[slot]] for slot in LENSES if models.get(slot, OFF) != OFF]
    # A reason other than a forced model for having no choice of defocus says why no picture decides the answer.
    pictured = "microlens_diffraction" in models and reasons.get("defocus_blur", "") in ("", NAMED)
    if not parts:
        parts = ["no diffraction"] if pictured else []
    if reasons.get("calibration") and models["calibration"] == OFF and "calibration" not in choice.forced:
        parts.append(reasons["calibration"])
    elif "calibration" in models:
        drawn = listed([f"“{reading}”" for reading in choice.other_models])
        model = models["calibration"]
        words = "without calibration errors" if model == OFF else MODEL["calibration", model]
        parts.append(words + f" (exact for {drawn})" * bool(drawn))
    if "sampling" in models:
        parts.append(f"sampled to {models['sampling']}")
    if not pictured and "calibration" in models:
        why = reasons.get("defocus_blur", "")
        parts.insert(0, f"geometry only ({why})" if why else "geometry only")
        return "; ".join(parts)
    return ", ".join(parts) or "geometry only"


def _left_out(choice: Choice) -> str:
    """The omission with the largest change, and the change due to all omissions with its tolerance."""
    omitted = [
        (change.relative / choice.asked[quantity], quantity, change, decision)
        for decision in choice.decisions
        if decision.chosen and not decision.forced
        for quantity, change in decision.changes.items()
        if quantity in choice.asked and change.relative > 0.0
    ]
    if not omitted:
        return _without_effect(choice) or "nothing left out" + _first_refused(choice)
    _, quantity, _, decision = max(omitted, key=lambda omission: omission[0])
    change = choice.changes[quantity]  # due to all omissions; can be less than that due to one of them
    significant = {id(omission[3]) for omission in omitted if omission[0] >= _SIGNIFICANT}
    suffix = " and smaller effects together" if len(significant) > 1 else ""
    return (
        f"leaving out {left_out(decision.slot, decision.model)}{suffix} changes the {IN_WORDS[quantity]} by "
        f"{_amount(change, choice.asked[quantity])} {_allowance(quantity, change, choice)}"
    )


def _without_effect(choice: Choice) -> str:
    """The omissions that change no answer; empty if nothing is left out."""
    complete = choice.problem.complete
    omissions = [
        left_out(decision.slot, decision.model)
        for decision in choice.decisions
        if decision.chosen and not decision.forced and decision.model != complete[decision.slot]
    ]
    return f"leaving out {listed(omissions)} changes nothing" if omissions else ""


def _first_refused(choice: Choice) -> str:
    """The omission that comes closest to its tolerance without meeting it, which explains why nothing is left out."""
    refused = [
        (max(change.relative / choice.asked[quantity] for quantity, change in changes.items()), decision, changes)
        for decision in choice.decisions
        if not decision.chosen and decision.slot not in choice.forced and not choice.problem.reasons.get(decision.slot)
        if (changes := {quantity: change for quantity, change in decision.changes.items() if quantity in choice.asked})
    ]
    refused = [refusal for refusal in refused if refusal[0] > 1.0]
    if not refused:
        return ""
    _, decision, changes = min(reversed(refused), key=lambda refusal: refusal[0])  # of equals, the most complete model
    quantity, change = max(changes.items(), key=lambda item: item[1].relative / choice.asked[item[0]])
    omission = left_out(decision.slot, decision.model)
    if math.isinf(change.relative):
        allowed = pretty(choice.asked[quantity], FRACTION)
        return (
            f", because it is unknown by how much leaving out {omission} would change the {IN_WORDS[quantity]} "
            f"({allowed} allowed)"
        )
    return (
        f", because leaving out {omission} would change the {IN_WORDS[quantity]} by "
        f"{_amount(change, choice.asked[quantity])} {_allowance(quantity, change, choice)}"
    )


def _allowance(quantity: Quantity, change: Change, choice: Choice) -> str:
    """The evidence of a change, if it is a trial, and the tolerance, in brackets."""
    how = f"{_tried(quantity)}; " if change.evidence == "trial" else ""
    return f"({how}{pretty(choice.asked[quantity], FRACTION)} allowed)"


def _forced(choice: Choice) -> str:
    if not choice.by_forcing:
        return ""
    quantity, change = max(
        ((q, c) for q, c in choice.by_forcing.items() if q in choice.asked), key=lambda item: item[1].relative
    )
    if change.relative == 0.0:
        return ""
    models = ", ".join(
        f"{slot.replace('_', ' ')}: {model}" for slot, model in choice.forced.items() if slot in choice.models
    )
    more = "more than" if change.relative > choice.asked[quantity] else "within"
    return (
        f"{models}, as the study requires, changes the {IN_WORDS[quantity]} by "
        f"{_share(quantity, change, choice)}, {more} the {pretty(choice.asked[quantity], FRACTION)} allowed"
    )


def _decisions(choice: Choice) -> Iterator[str]:
    """Every model of every effect with its change, or the reason why the effect has only one model."""
    for quantity in dict.fromkeys([*choice.asked, *choice.changes]):
        share = _share(quantity, choice.changes[quantity], choice)
        limit = (
            f"{pretty(choice.asked[quantity], FRACTION)} allowed"
            if quantity in choice.asked
            else "no tolerance applies"
        )
        yield f"all omissions together change the {IN_WORDS[quantity]} by {share}; {limit}"
    stated: set[str] = set()
    yield "● used, ○ not used; each change is relative to the most complete model of the effect"
    for decision in choice.decisions:
        mark, label = "●" if decision.chosen else "○", f"{decision.slot.replace('_', ' ')}: {decision.model}"
        if reason := choice.problem.reasons.get(decision.slot):
            once = "" if reason in stated else f"  {reason}"
            stated.add(reason)
            yield f"{mark} {label}{once}"
            continue
        judged = ((quantity, change) for quantity, change in decision.changes.items() if quantity in choice.asked)
        changed = ", ".join(
            f"the {IN_WORDS[quantity]} by {_share(quantity, change, choice)}" for quantity, change in judged
        )
        yield f"{mark} {label}" + f"  changes {changed}" * bool(changed)


def _share(quantity: Quantity, change: Change, choice: Choice) -> str:
    """A change and its evidence: "0.22 %", "up to about 1.3 %", "about 0.02 % (trial at a few distances)"."""
    if math.isinf(change.relative) or change.relative == 0.0:
        return _amount(change)
    amount = _amount(change, choice.asked.get(quantity, math.nan))
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
    prefixes: dict[Evidence, str] = {"computed": "", "rule": "up to about ", "trial": "about "}
    size, allowed = pretty(change.relative, FRACTION, digits=2), pretty(tolerance, FRACTION)
    if size == allowed:
        digits = fewest_digits(lambda digits: pretty(change.relative, FRACTION, digits=digits) != allowed)
        size = pretty(change.relative, FRACTION, digits=digits)
    return f"{prefixes[change.evidence]}{size}"
