"""Predict the time of a study, step by step: time pilots of its work on this machine and scale them by their counts."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from tradestudy.analysis.claims import claims_in_order
from tradestudy.analysis.ranks import rank_distances
from tradestudy.cameras.depth_camera import DepthCamera
from tradestudy.cameras.depth_measurement import CORNERS
from tradestudy.imaging.derived_error import kirchhoff_lattice
from tradestudy.optics.arrays import FloatArray
from tradestudy.plan import pilots
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.document import Entry, Value
from tradestudy.study.schema.depth_of_field import PROBLEM
from tradestudy.study.schema.light_spot import LightSpotPart
from tradestudy.study.schema.questions import (
    ClaimPart,
    DepthOfFieldClaim,
    DepthOfFieldRatioClaim,
    FresnelFNumberClaim,
    ImageDifferenceClaim,
    LimitDistanceClaim,
    LitPixelsClaim,
    PsfErrorClaim,
    RelativeUncertaintyDistanceClaim,
    ShareBetterClaim,
    UncertaintyRatioClaim,
)
from tradestudy.study.schema.trade_off import TradeOffPart
from tradestudy.study.schema.wave_optics import listed
from tradestudy.study.sweep import calibrations_to_infer, sweep_axes
from tradestudy.wording import counted

if TYPE_CHECKING:  # few studies ask for light, or infer
    from tradestudy.analysis.spot_images import SpotModels
    from tradestudy.calibration.posteriors import CornersToInfer
    from tradestudy.calibration.target.camera_target import TargetToInfer

# Time of other questions about a camera, in units of its table over all distances: a verdict finds crossovers and
# switches of the winner for three error sources; a claim needs part of one, if it is not cached.
_TABLES_OF_A_DATASHEET: Final = 1.0  # and of the distances of the decision
_TABLES_OF_A_VERDICT: Final = 0.8
_TABLES_OF_A_CLAIM: Final = 0.16
_TABLES_OF_AN_ANSWER: Final = 0.23  # to a requirement under one reading
_FIRST_DISTANCES: Final = 3
_TRIALS_OF_A_ROOT: Final = 12
_TRIALS_OF_A_REQUIREMENT: Final = 9  # with new tables, on average: those of unchanged cameras are kept
_TABLES_OF_A_DRAW: Final = 0.07
_TABLES_OF_A_TRIAL: Final = 0.05
_PAIRS_OF_A_CLAIM: Final = 0.6  # on average, since several claims read the same pair
_PAIRS_OF_A_ROOT: Final = 0.55  # on average: a limit is often below or beyond all f-numbers, whose pairs are cached
# Pilots of drawing and typesetting would need their libraries, whose loading takes half of the time. Both are
# mixed interpreter work, like parsing a study: these are the numbers of small studies parsed in the same time.
_PARSED_IN_A_REPORT: Final = 60
_PARSED_IN_A_FIGURE: Final = 25
_PARSED_IN_A_ROW: Final = 1  # a verdict on a claim under one reading
_PARSED_IN_A_DATASHEET: Final = 4  # and in a verdict, besides their tables
_PARSED_IN_A_SWEPT_ANSWER: Final = 0.3  # to a requirement in one design, whose tables are known
_PARSED_IN_A_RANKED_VALUE: Final = 0.25  # over all weights


@dataclass(frozen=True, kw_only=True)
class PredictedStep:
    """One step of a run on one worker.

    Parameters
    ----------
    name
        Name of the step in the run's progress.
    seconds
        Wall time under the present load of the machine.
    work
        The amount of work, in words.
    problems
        Seconds for each problem of the study that the step solves, by name.
    parts
        Seconds of parts of unequal length, in the order in which the run computes them.
    """

    name: str
    seconds: float
    work: str
    problems: Mapping[str, float] = field(default_factory=dict)
    parts: tuple[float, ...] = ()


class Stopwatch:
    """The ratio of wall time to processor time, which grows when other programs use the processor too."""

    def __init__(self) -> None:
        self._began = time.perf_counter(), time.process_time()

    @property
    def waiting(self) -> float:
        """Wall time divided by processor time since the watch was made; at least 1, even if threads made it less."""
        wall, processor = time.perf_counter() - self._began[0], time.process_time() - self._began[1]
        return max(1.0, wall / processor) if processor > 0.0 else 1.0


def predicted_steps(definition: StudyDefinition, watch: Stopwatch) -> tuple[PredictedStep, ...]:
    """Predict every step of a run, in order, including its report, for a study with its models applied.

    The watch must have run long enough to tell how busy the processor is, for example since planning began.
    """
    steps = tuple(_Prediction(definition=definition).steps())
    waiting = watch.waiting
    return tuple(
        replace(
            step,
            seconds=waiting * step.seconds,
            problems={name: waiting * seconds for name, seconds in step.problems.items()},
            parts=tuple(waiting * seconds for seconds in step.parts),
        )
        for step in steps
    )


@dataclass(frozen=True, kw_only=True)
class _Prediction:
    """The pilots of one study, each made once."""

    definition: StudyDefinition
    tables: dict[object, tuple[float, float]] = field(default_factory=dict)
    pictures: dict[SpotModels, float] = field(default_factory=dict)

    def steps(self) -> Iterator[PredictedStep]:
        file = self.definition.file
        if self.definition.case.cameras:
            yield from self._depth()
        if file.scene is not None and file.scene.image is not None:
            from tradestudy.plan.rendering_pilot import scene_work

            for name, by_camera, work in scene_work(self.definition):
                yield PredictedStep(name=name, seconds=math.fsum(by_camera), work=work, parts=by_camera)
        if file.depth_loop is not None:
            from tradestudy.plan.rendering_pilot import loop_work

            planes, work = loop_work(self.definition, file.depth_loop)
            yield PredictedStep(name="depth loop", seconds=math.fsum(planes), work=work, parts=planes)
        if file.sensitivity is not None:
            yield self._sensitivity(np.array(file.sensitivity.at))
        if file.depth_of_field is not None:
            cameras = len(self.definition.case.all_cameras)
            seconds = cameras * self.parsing
            yield PredictedStep(
                name="depth of field",
                seconds=seconds,
                work=counted(cameras, "camera"),
                problems={PROBLEM: seconds},
            )
        if file.fresnel_validity is not None:
            yield from self._fresnel_validity()
        if file.light_spot is not None:
            yield from self._light_spot(file.light_spot)
        if file.point_spread is not None:
            part = file.point_spread
            varied = (listed(part.f_numbers), part.wavelengths, part.field_angles, part.defocus)
            count = 2 * len(part.elements) * sum(map(len, varied))
            yield PredictedStep(
                name="point spread",
                seconds=count * pilots.spread_seconds(part),
                work=counted(count, "point-spread function"),
            )
        if file.hard_cases is not None:
            yield self._hard_cases(file.hard_cases.families)
        if file.claims or file.requirements:
            yield self._claims()
        if file.sweep and file.requirements:
            answers = math.prod(len(axis.values) for axis in sweep_axes(self.definition)) * len(file.requirements)
            seconds = answers * _PARSED_IN_A_SWEPT_ANSWER * self.parsing
            yield PredictedStep(name="requirements", seconds=seconds, work=counted(answers, "answer"))
        if file.trade_off is not None:
            yield self._trade_off(file.trade_off)
        if file.solve:
            parts = tuple(self._seconds_of_question(name) for name in file.solve)
            work = counted(len(parts), "question")
            yield PredictedStep(name="inverse questions", seconds=math.fsum(parts), work=work, parts=parts)
        yield self._report()

    @cached_property
    def parsing(self) -> float:
        """Time to parse a small study [s]."""
        return pilots.parsing_seconds()

    @cached_property
    def design(self) -> float:
        """Time to read this study with one value changed [s]."""
        changed: dict[str, Value | Entry] = {axis.path: axis.values[-1] for axis in sweep_axes(self.definition)}
        for question in self.definition.file.solve.values():
            changed |= dict.fromkeys(question.paths, question.low)
        return pilots.seconds_of(lambda: self.definition.with_values(changed).case)

    def picture(self, part: LightSpotPart, models: SpotModels) -> float:
        """Time for a picture of the spot [s]; a reading's picture takes as long as the study's."""
        from tradestudy.plan.light_pilot import predicted_picture_seconds

        if models not in self.pictures:
            self.pictures[models] = predicted_picture_seconds(part, models)
        return self.pictures[models]

    def table(self, camera: DepthCamera) -> tuple[float, float]:
        """Times of a camera's table and of its draws [s], the same for all cameras of one kind with the same models."""
        case, law = self.definition.case, camera.disparity_error_px
        kind = (type(camera), camera.propagation.model, bool(camera.calibration.groups), getattr(law, "models", None))
        if not self.tables:  # the first camera fills caches that the others use
            pilots.table_seconds(camera, case.criteria, case.distance[:_FIRST_DISTANCES])
        if kind not in self.tables:
            self.tables[kind] = (
                pilots.table_seconds(camera, case.criteria, case.distance),
                pilots.drawing_seconds(camera, case.distance.size),
            )
        return self.tables[kind]

    @cached_property
    def prior_cameras(self) -> dict[str, DepthCamera]:
        """The cameras; one whose calibration the run has yet to infer has its priors, if it declares any."""
        asked = self.definition.calibrations_to_infer().values()
        priors = {one.name: getattr(one, "groups", ()) for one in asked}
        return {
            name: replace(camera, calibration=replace(camera.calibration, groups=priors[name], inferred=True))
            if priors.get(name)
            else camera
            for name, camera in self.definition.case.cameras.items()
        }

    @cached_property
    def cameras(self) -> dict[str, tuple[float, float]]:
        """Times of every camera [s]."""
        return {name: self.table(camera) for name, camera in self.prior_cameras.items()}

    @cached_property
    def designs(self) -> dict[str, int]:
        """How many designs of each camera a sweep computes: an axis that does not change a camera adds none."""
        found = dict.fromkeys(self.cameras, 1)
        for axis in sweep_axes(self.definition):
            others = [v for v, label in zip(axis.values, axis.labels, strict=True) if label != axis.declared]
            if not others:  # its only value is the declared one
                continue
            changed = self.definition.with_values({axis.path: others[0]}).case.cameras
            for name, camera in self.definition.case.cameras.items():
                found[name] *= len(axis.values) if changed[name] != camera else 1
        return found

    @property
    def all_tables(self) -> float:
        """Time of all cameras' tables [s], without draws, which `depth` caches."""
        return math.fsum(table for table, _ in self.cameras.values())

    def _depth(self) -> Iterator[PredictedStep]:
        definition, file, case = self.definition, self.definition.file, self.definition.case
        asked = list(calibrations_to_infer(definition).values())
        if asked:
            parts = self._seconds_of_inference(asked)
            work = counted(len(asked), "posterior")
            yield PredictedStep(name="calibration", seconds=math.fsum(parts), work=work, parts=parts)
        yield from self._pictures()
        designs = math.prod(len(axis.values) for axis in sweep_axes(definition))
        points = math.fsum(self.designs[name] * sum(seconds) for name, seconds in self.cameras.items())
        cameras, distances = counted(len(case.cameras), "camera"), counted(case.distance.size, "distance")
        yield PredictedStep(
            name="depth",
            seconds=points + (designs * self.design if file.sweep else 0.0),
            work=f"{counted(designs, 'design')} of {cameras} at {distances}",
            problems={name: self.designs[name] * sum(seconds) for name, seconds in self.cameras.items()},
        )
        if places := len(CORNERS) * len(file.propagation.field_places):
            yield PredictedStep(
                name="depth off the axis",
                seconds=places * math.fsum(sum(seconds) for seconds in self.cameras.values()),
                work=f"{counted(places, 'place')} of {cameras} at {distances}",
                problems={name: places * table for name, (table, _) in self.cameras.items()},  # the run adds draws
            )
        yield from self._decision()
        if (part := file.value_of_information) is not None:
            each = self.design + _TABLES_OF_A_DRAW * self.all_tables * (1 + len(file.requirements))
            yield PredictedStep(
                name="value of information", seconds=part.draws * each, work=counted(part.draws, "combination")
            )

    def _seconds_of_inference(self, asked: Sequence[TargetToInfer | CornersToInfer]) -> tuple[float, ...]:
        """Time of each calibration [s]; in a sweep, the mean of a camera's first and last one stands for each."""
        means: dict[str, float] = {}
        for name in {one.name for one in asked}:
            own = [one for one in asked if one.name == name]
            tried = [pilots.inference_seconds(one, self.parsing) for one in own[:: max(1, len(own) - 1)]]
            means[name] = math.fsum(tried) / len(tried)
        return tuple(means[one.name] for one in asked)

    def _sensitivity(self, at: FloatArray) -> PredictedStep:
        fields = self.definition.file.propagation.axis_and_places
        inferred = {one.name for one in self.definition.calibrations_to_infer().values()}
        seconds = math.fsum(
            pilots.sensitivity_seconds(camera, at, fields, inferred=name in inferred)
            for name, camera in self.prior_cameras.items()
        )
        cameras = counted(len(self.prior_cameras), "camera")
        work = f"the error sources of {cameras} at {counted(len(fields), 'field position')}"
        return PredictedStep(name="sensitivity", seconds=seconds, work=work)

    def _pictures(self) -> Iterator[PredictedStep]:
        points = kirchhoff_lattice(self.definition.case.cameras.values(), self.definition.case.distance)
        if points:
            seconds = pilots.correction_seconds(points)
            work = f"Kirchhoff diffraction at {counted(len(points), 'value')} of defocus"
            yield PredictedStep(name="pictures", seconds=seconds, work=work)

    def _decision(self) -> Iterator[PredictedStep]:
        file = self.definition.file
        cases = [self.definition, *self.definition.readings.values()] if file.decision is not None else []
        pair = file.decision.between if file.decision is not None else ()
        verdicts = (self._tables_of(pair, one, _TABLES_OF_A_VERDICT) for one in cases)
        besides = _PARSED_IN_A_DATASHEET * self.parsing
        parts = (_TABLES_OF_A_DATASHEET * self.all_tables + besides, *(verdict + besides for verdict in verdicts))
        yield PredictedStep(
            name="decision",
            seconds=math.fsum(parts) + (self.all_tables if file.sweep else 0.0),
            work=f"{counted(len(cases), 'verdict')} on the main pair",
            parts=parts,
        )
        if file.decision is not None:
            pairs = file.decision.compare or (file.decision.between,)
            distance = rank_distances(self.definition.case.distance, file.decision.at)
            known = {
                name: pilots.ranking_seconds(self.prior_cameras[name], distance)
                for name in dict.fromkeys(itertools.chain(*pairs))
            }
            seconds = math.fsum(known[name] for pair in pairs for name in pair)
            yield PredictedStep(name="ranks", seconds=seconds, work=counted(len(pairs), "pair"))

    def _seconds_of_question(self, name: str) -> float:
        """Time for all values tried to answer an inverse question [s], in every plan of a calibration."""
        from tradestudy.analysis.inverse_questions import planning_work

        definition, question = self.definition.under(name), self.definition.file.solve[name]
        if not question.requirement and (plans := planning_work(definition, question)):
            plans[0]()  # fills caches
            return _TRIALS_OF_A_ROOT * len(plans) * pilots.seconds_of(plans[-1])
        tables = self._tables_of(tuple(self.cameras), definition)
        return _TRIALS_OF_A_REQUIREMENT * (self.design + _TABLES_OF_A_TRIAL * tables)

    def _tables_of(self, names: tuple[str, ...], case: StudyDefinition, tables: float = 1.0) -> float:
        """Time of a number of tables of each camera [s], and of the draws of cameras that a reading changes."""
        declared, cameras = self.definition.case.cameras, case.case.cameras
        found = (self.cameras[name] if cameras[name] == declared[name] else self.table(cameras[name]) for name in names)
        changed = [cameras[name] != declared[name] for name in names]
        return math.fsum(tables * table + draws * new for (table, draws), new in zip(found, changed, strict=True))

    def _fresnel_validity(self) -> Iterator[PredictedStep]:
        part = self.definition.file.fresnel_validity
        assert part is not None
        f_numbers, wavelengths, elements = len(listed(part.f_numbers)), len(part.wavelengths), part.elements.values()
        pairs = len(part.elements) * wavelengths * (f_numbers + 2)
        yield PredictedStep(
            name="Fresnel against Kirchhoff, on axis",
            seconds=pairs * self.pair_on_axis,
            work=f"{counted(pairs, 'pair')} of point-spread functions",
        )
        limits = len(part.elements) * len(part.lens_phases) * wavelengths * (1 + 2 * len(part.windows))
        yield PredictedStep(
            name="f-numbers at the limit",
            seconds=_PAIRS_OF_A_ROOT * limits * self.pair_on_axis,
            work=counted(limits, "root"),
        )
        if part.off_axis is not None:
            angle = part.off_axis.field_angle
            one = math.fsum(pilots.pair_seconds(part, element, field_angle=angle) for element in elements)
            yield PredictedStep(
                name="Fresnel against Kirchhoff, off axis",
                seconds=(f_numbers + 1) * one,
                work=f"{len(part.elements) * (f_numbers + 1)} pairs of point-spread functions",
            )

    @cached_property
    def pair_on_axis(self) -> float:
        part = self.definition.file.fresnel_validity
        assert part is not None
        return pilots.pair_seconds(part, next(iter(part.elements.values())))

    def _light_spot(self, part: LightSpotPart) -> Iterator[PredictedStep]:
        """Pictures by the compared methods, and by the chosen models if they are not among these."""
        from tradestudy.analysis.spot_images import compared_models
        from tradestudy.plan.problems.light_spot import NAME, spot_models

        asked = [compared_models(part, method) for method in part.methods]
        names = self.definition.models.get(NAME)
        if names and (chosen := spot_models(names)) not in asked:
            asked.append(chosen)
        parts = tuple(self.picture(part, models) for models in asked)
        yield PredictedStep(
            name="image of the spot",
            seconds=math.fsum(parts),
            work=f"{counted(len(asked), 'picture')}: {', '.join(models.method for models in asked)}",
            problems={NAME: math.fsum(parts)},
            parts=parts,
        )
        if part.benchmarks:
            point = self.picture(part, replace(compared_models(part, "kirchhoff"), point=True))
            yield PredictedStep(name="benchmarks of light", seconds=point, work="18 apertures, one source point")

    def _hard_cases(self, names: tuple[str, ...]) -> PredictedStep:
        from tradestudy.verification.hard_case_families import all_families

        efforts = [case.effort for family in all_families() if family.name in names for case in family.cases]
        seconds = math.fsum(efforts) * self.parsing
        return PredictedStep(name="hard cases", seconds=seconds, work=counted(len(efforts), "case"))

    def _claims(self) -> PredictedStep:
        """All claims under each of their readings, with the pictures of the spot that no earlier step needed."""
        file = self.definition.file
        readings = {"": self.definition, **self.definition.readings}
        asked = claims_in_order(file.claims, list(readings))
        pictures = self._pictures_of_claims([(file.claims[key], readings[name]) for key, name in asked])
        answers = [
            self._seconds_of_claim(file.claims[key], readings[name]) + pictured
            for (key, name), pictured in zip(asked, pictures, strict=True)
        ]
        judged = _TABLES_OF_AN_ANSWER * self.all_tables * len(readings)
        parts = (*answers, *[judged] * len(file.requirements))
        return PredictedStep(
            name="claims",
            seconds=math.fsum(parts),
            work=f"{counted(len(asked), 'verdict')} on claims, {counted(len(file.requirements), 'requirement')}",
            parts=parts,
        )

    def _pictures_of_claims(self, asked: Sequence[tuple[ClaimPart, StudyDefinition]]) -> list[float]:
        """Time [s] for those pictures of each claim that no earlier claim has needed."""
        if (declared := self.definition.file.light_spot) is None:
            return [0.0] * len(asked)
        from tradestudy.analysis.spot_images import compared_models, without_comparison

        known = {(without_comparison(declared), declared.tolerance, method) for method in declared.methods}
        found = [0.0] * len(asked)
        for number, (claim, reading) in enumerate(asked):
            if isinstance(claim, ImageDifferenceClaim | LitPixelsClaim):
                for method in (claim.method, claim.reference):
                    spot = reading.file.light_spot
                    assert spot is not None  # it is valid
                    if (key := (without_comparison(spot), spot.tolerance, method)) not in known:
                        known.add(key)
                        found[number] += self.picture(spot, compared_models(spot, method))
        return found

    def _trade_off(self, part: TradeOffPart) -> PredictedStep:
        """Computed criteria in every design, and ranks over the weights."""
        computed = sum(one.quantity is not None for one in part.criteria.values())
        ranked = self.definition.file.ranked
        tables = math.fsum(self.designs[name] * self.cameras[name][0] for name in ranked) if computed else 0.0
        cells = len(ranked) * len(part.criteria)
        return PredictedStep(
            name="trade-off",
            seconds=computed * tables + _PARSED_IN_A_RANKED_VALUE * cells * self.parsing,
            work=f"{counted(len(ranked), 'camera')} by {counted(len(part.criteria), 'criterion', 'criteria')}",
        )

    def _seconds_of_claim(self, claim: ClaimPart, reading: StudyDefinition) -> float:
        match claim:
            case PsfErrorClaim() | FresnelFNumberClaim():
                return _PAIRS_OF_A_CLAIM * self.pair_on_axis
            case DepthOfFieldClaim() | DepthOfFieldRatioClaim():
                return self.parsing
            case LimitDistanceClaim():
                return _TABLES_OF_A_TRIAL * self.cameras[claim.camera][0]
            case UncertaintyRatioClaim() | ShareBetterClaim():
                return self._seconds_of_uncertainties((claim.camera, claim.against), reading)
            case RelativeUncertaintyDistanceClaim():
                return self._seconds_of_uncertainties((claim.camera,), reading)
            case _:
                return 0.0  # a closed form, or pictures, which are counted elsewhere

    def _seconds_of_uncertainties(self, names: tuple[str, ...], reading: StudyDefinition) -> float:
        """Time of the uncertainties of a claim's cameras [s], of which those of a declared camera are cached."""
        declared, cameras = self.definition.case.cameras, reading.case.cameras
        return math.fsum(
            _TABLES_OF_A_TRIAL * self.cameras[name][0]
            if cameras[name] == declared[name]
            else _TABLES_OF_A_CLAIM * math.fsum(self.table(cameras[name]))
            for name in names
        )

    def _report(self) -> PredictedStep:
        file = self.definition.file
        pictured = len(self.definition.case.all_cameras) if file.scene is not None and file.scene.image else 0
        typical_figures = (
            3 * bool(self.definition.case.cameras)
            + 4 * bool(file.sweep)
            + bool(file.decision)
            + 2 * len(self.definition.calibrations_to_infer())
            + len(self.definition.case.cameras) * (file.sensitivity is not None)
            + 2 * pictured
            + (file.depth_loop is not None)
            + (file.value_of_information is not None)
            + 3 * (file.depth_of_field is not None)
            + 2 * (file.fresnel_validity is not None)
            + (file.light_spot is not None)
            + (file.point_spread is not None)
            + (file.hard_cases is not None)
            + (file.trade_off is not None)
        )
        rows = len(file.claims) * (1 + len(self.definition.readings))
        parsed = _PARSED_IN_A_REPORT + typical_figures * _PARSED_IN_A_FIGURE + rows * _PARSED_IN_A_ROW
        return PredictedStep(name="report", seconds=parsed * self.parsing, work="figures, HTML, PDF")
