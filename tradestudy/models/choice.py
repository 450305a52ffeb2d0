"""Choose the models of every problem of a study, or refuse the study."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence

from tradestudy.accuracy import IN_WORDS, QUANTITIES
from tradestudy.effects import OFF, Models
from tradestudy.errors import Problem, StudyError, UnaffordableError
from tradestudy.models.problem import Choice, SimulationProblem, choose
from tradestudy.study.prepared import PreparedStudy


def problems(study: PreparedStudy, forced: Models) -> Iterator[SimulationProblem]:
    """Every problem of a study that needs models, in the order in which a run solves them."""
    # Imported only where needed, because `check` calls this too, and few studies simulate light.
    file, case = study.file, study.case
    if case.cameras:
        from tradestudy.models.depth_problem import depth_problems

        yield from depth_problems(study, forced)
    if (sharp := file.depth_of_field) is not None:
        from tradestudy.models.sharpness import DepthOfFieldProblem

        focuses = [camera.focus for camera in case.all_cameras.values()]
        yield DepthOfFieldProblem(
            focuses, [part.criterion(case.wavelength) for part in sharp.criteria.values()], forced
        )
    if file.scene is not None and file.scene.image is not None:
        from tradestudy.models.scene_pictures import picture_problems

        yield from picture_problems(study, forced)
    if file.light_spot is not None:
        from tradestudy.models.light_spot import LightSpotProblem

        yield LightSpotProblem(file.light_spot, forced)
    if file.point_spread is not None:
        from tradestudy.models.sharpness import PointSpreadProblem

        yield PointSpreadProblem(file.point_spread, forced)


def choose_models(study: PreparedStudy) -> list[Choice]:
    """Choose the cheapest models that keep every requested quantity within its tolerance, problem by problem.

    The choice depends on the study alone, not on the machine or its load.

    Raises
    ------
    UnaffordableError
        If even the most complete models exceed a tolerance; one error for all problems.
    StudyError
        If the study forces a model that applies to nothing in it, or sets a tolerance on a quantity that it does not
        compute.
    """
    forced = study.file.effects.forced()
    all_problems = tuple(problems(study, forced))
    if mistakes := [*_ignored_tolerances(study, all_problems), *_ignored_models(study, all_problems, forced)]:
        raise StudyError(mistakes)
    return choose_each(study, all_problems, problems(study, {}) if forced else ())


def choose_each(
    study: PreparedStudy, problems: Iterable[SimulationProblem], free: Iterable[SimulationProblem] = ()
) -> list[Choice]:
    """Choose the models of some problems; ``free`` holds the same problems without the models that the study forces.

    Raises
    ------
    UnaffordableError
        If even the most complete models exceed a tolerance; one error for all problems.
    """
    forced, tolerances = study.file.effects.forced(), study.file.accuracy.asked().tolerances
    without = {problem.name: problem for problem in free}
    choices, refused = [], []
    for problem in problems:
        try:
            choices.append(choose(problem, tolerances, forced, without.get(problem.name)))
        except UnaffordableError as error:
            refused.append(error)
    if refused:
        raise refused[0] if len(refused) == 1 else UnaffordableError("\n".join(map(str, refused)))
    return choices


def refuse_chosen_spot(study: PreparedStudy, choices: Sequence[Choice]) -> None:
    """Refuse the picture of a light spot by its chosen models as `refuse_picture` does; nothing without a spot."""
    if (spot := study.file.light_spot) is not None:
        from tradestudy.models.light_spot import NAME, spot_models
        from tradestudy.models.light_trial import refuse_picture

        models = spot_models(next(choice.models for choice in choices if choice.name == NAME))
        refuse_picture(spot, models, "the sampling of the chosen picture, which follows from the key accuracy")


def choose_depth_models(study: PreparedStudy, names: Collection[str]) -> dict[str, Models]:
    """The models that `choose_models` chooses for some cameras that measure depth, by camera.

    Raises
    ------
    UnaffordableError
        If even the most complete models exceed a tolerance.
    """
    from tradestudy.models.depth_problem import depth_problems

    requested = (problem for problem in depth_problems(study, study.file.effects.forced()) if problem.name in names)
    return {choice.name: choice.models for choice in choose_each(study, requested)}


def _ignored_tolerances(study: PreparedStudy, problems: tuple[SimulationProblem, ...]) -> Iterator[Problem]:
    """Tolerances on quantities that the study does not compute."""
    part = study.file.accuracy
    for quantity in QUANTITIES:
        if getattr(part, quantity) is None or any(quantity in problem.asked for problem in problems):
            continue
        path = ("accuracy", quantity)
        message = f"no part of this study computes this quantity ({IN_WORDS[quantity]}); remove its tolerance"
        yield study.document.locate(path).problem(path, message)


def _ignored_models(study: PreparedStudy, problems: tuple[SimulationProblem, ...], forced: Models) -> Iterator[Problem]:
    """Forced models that apply to nothing in the study."""
    for effect, model in forced.items():
        slots = [slot for problem in problems for slot in problem.slots if slot.name == effect]
        offered = dict.fromkeys(offered_model for slot in slots for offered_model in slot.models)
        # Every camera that measures depth propagates calibration errors, even if it has none.
        if model in offered or (effect == "calibration" and slots):
            continue
        message = f"'{model}' applies to nothing in this study"
        if set(offered) - {OFF}:
            message += f"; its models of this effect are {', '.join(offered)}"
        else:
            reasons = "; ".join(dict.fromkeys(slot.reason for slot in slots if slot.reason))
            message += f": {reasons}" if reasons else ": no part of it has this effect"
        yield study.document.locate(("effects", effect)).problem(("effects", effect), message)
