"""Requirements checked on cameras and designs: verdicts, margins, guard bands, and where a sweep meets them."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tradestudy
from tradestudy.answers.ranks import ranks_group
from tradestudy.answers.requirement_answer import RequirementAnswer
from tradestudy.answers.requirement_verdicts import requirements_group
from tradestudy.answers.requirements import Judge, _shift_to_decide, _unusable, check_requirement, is_kept
from tradestudy.depth.evaluation import evaluate_depth
from tradestudy.depth.table import judged_uncertainty, judged_uncertainty_error
from tradestudy.depth.usable import END_OF_STUDY, Interval
from tradestudy.errors import OutOfRangeError, StudyError
from tradestudy.execution import Processes, Steps
from tradestudy.results.views.designs import common_ranges
from tradestudy.study.schema.requirements import GuardBandPart, RequirementPart
from tradestudy.study.varying import sweep_axes, sweep_points
from tradestudy.wording import limit_words

STUDIES = Path(__file__).parents[2] / "studies"
ROBOT = STUDIES / "robot.yaml"
ONE_PER_CENT = {"depth_uncertainty": {"below_relative": "1 %", "over": ["0.4 m", "3 m"]}}


def answer(**values: Any) -> RequirementAnswer:
    plain = {
        "camera": "a", "met": True, "value": 0.009, "bound": 0.01, "place": 1.0, "error": 5e-4,
        "margin": 0.01 / 0.009 - 1, "unusable": 0.0, "reason": "",
    }  # fmt: skip
    return RequirementAnswer(**(plain | values))


def robot(**requirements: dict[str, Any]) -> tradestudy.Study:
    own = {name: {"says": name, **values} for name, values in requirements.items()}
    return tradestudy.load(ROBOT).with_values({"requirements": {"near-and-mid": None, **own}})


def part(study: tradestudy.Study, name: str) -> RequirementPart:
    return study.file.requirements[name]


def test_conformity_is_the_probability_that_the_true_value_meets_the_bound() -> None:
    """Limit 1 %, value 0.9 %, u 0.05 %: Φ(2) = 0.97725; 5 % risk needs 1.645 u."""
    one = answer()
    assert one.margin_in_errors == pytest.approx(2.0)
    assert one.conformity == pytest.approx(0.9772499, abs=1e-6)
    assert GuardBandPart.model_validate({"risk": "5 %"}).width == pytest.approx(1.6448536, abs=1e-6)
    assert answer(value=0.011, margin=0.01 / 0.011 - 1).conformity == pytest.approx(0.0227501, abs=1e-6)
    assert answer(error=0.0).conformity == 1.0
    assert math.isnan(answer(met=None, margin=math.nan).conformity)


def test_the_worst_value_must_stay_a_guard_band_away_from_the_bound() -> None:
    study = robot(near={"camera": "stereo-75mm", **ONE_PER_CENT})
    case, required = study.prepared.case, part(study, "near")
    plain = check_requirement(required, case, "stereo-75mm")
    assert plain.met
    assert plain.error > 0.0
    errors = (plain.bound - plain.value) / plain.error
    for width, met in ((0.99 * errors, True), (1.01 * errors, False)):
        guarded = required.model_copy(update={"guard_band": GuardBandPart.model_validate({"standard_errors": width})})
        assert check_requirement(guarded, case, "stereo-75mm").met is met


def test_the_worst_value_is_that_of_a_fine_grid() -> None:
    study = robot(near={"camera": "raytrix-r5", "depth_uncertainty": {"below": "5 mm", "over": ["0.4 m", "0.9 m"]}})
    case = study.prepared.case
    found = check_requirement(part(study, "near"), case, "raytrix-r5")
    fine = np.geomspace(0.4, 0.9, 4001)
    values = judged_uncertainty(case.cameras["raytrix-r5"], fine)
    assert found.value == pytest.approx(values.max(), rel=1e-6)
    assert found.place == pytest.approx(fine[values.argmax()], rel=1e-3)
    assert found.margin == pytest.approx(5e-3 / values.max() - 1.0, rel=1e-6)
    assert not found.met


def test_errors_of_single_values_equal_those_of_the_table() -> None:
    case, places = tradestudy.load(ROBOT).prepared.case, np.array([0.5, 1.0, 3.0])
    for camera in case.cameras.values():
        table = evaluate_depth(camera, places).judged_error[-1]
        np.testing.assert_allclose(judged_uncertainty_error(camera, places), table, rtol=1e-7)  # interpolated widths


def test_any_takes_the_best_camera_and_all_the_worst() -> None:
    study = robot(any={"camera": "any", **ONE_PER_CENT}, all={"camera": "all", **ONE_PER_CENT})
    judge, case = Judge(), study.prepared.case
    margins = {name: check_requirement(part(study, "any"), case, name).margin for name in case.cameras}
    nearest, every = judge.answer(part(study, "any"), case)
    farthest, _ = judge.answer(part(study, "all"), case)
    assert nearest.camera == max(margins, key=lambda name: margins[name]) == "stereo-75mm"
    assert farthest.camera == min(margins, key=lambda name: margins[name]) == "raytrix-r5"
    assert (nearest.met, farthest.met) == (True, False)
    assert {name: one.margin for name, one in every.items()} == margins


def test_an_unusable_camera_misses_by_at_least_its_unusable_share() -> None:
    study = robot(far={"camera": "raytrix-r5", "depth_uncertainty": {"below": "1 km", "over": ["0.4 m", "3 m"]}})
    found = check_requirement(part(study, "far"), study.prepared.case, "raytrix-r5")
    assert not found.met
    # The R5 is usable up to 1.832 m of these.
    assert found.unusable == pytest.approx(np.log(3.0 / 1.832) / np.log(3.0 / 0.4), abs=0.003)
    assert found.margin == -found.unusable
    assert "1.82 to 3 m" in found.reason  # from 1.829 m on, rounded outwards
    assert found.limit == "relative_uncertainty"


@pytest.mark.parametrize(
    ("over", "limit"),
    [
        (["2 m", "3 m"], "relative_uncertainty"),  # beyond the last usable interval
        (["20 mm", "30 mm"], "availability"),  # before the first one
    ],
)
def test_a_range_wholly_outside_the_usable_one_names_the_limit_broken_there(over: list[str], limit: str) -> None:
    study = robot(own={"camera": "raytrix-r5", "usable": {"over": over}})
    case = study.prepared.case
    found = check_requirement(part(study, "own"), case, "raytrix-r5")
    assert (found.met, found.unusable) == (False, 1.0)
    assert found.limit == limit
    assert ": " in found.reason


def intervals(*ends: float, first_limit: str = "overlap") -> list[Interval]:
    """Usable intervals from their ends, near, far, near, far …"""
    limits = [first_limit] + ["overlap"] * len(ends)
    return [
        Interval(near=near, far=far, near_limit=limit, far_limit="overlap")
        for near, far, limit in zip(ends[::2], ends[1::2], limits[::2], strict=False)
    ]


@pytest.mark.parametrize("ends", [(0.9, 2.5), (0.9, 1.5, 1.53, 2.5), (1.02, 2.5), (0.9, 1.98), (0.8, 0.99, 1.03, 2.2)])
def test_whether_a_range_is_covered_depends_on_ends_shifted_by_the_stated_share(ends: tuple[float, ...]) -> None:
    """Against the covered share after every end has been shifted outwards or inwards, just enough and just not."""

    def covered(shift: float) -> bool:
        signs = np.tile([-1.0, 1.0], len(ends) // 2)
        moved = np.array(ends) * (1.0 + shift * signs)
        return _unusable(intervals(*moved), (1.0, 2.0))[0] == 0.0

    shift = _shift_to_decide(intervals(*ends), (1.0, 2.0))
    outwards = 1.0 if not covered(0.0) else -1.0
    assert covered(outwards * 0.999 * shift) == covered(0.0)
    assert covered(outwards * 1.001 * shift) != covered(0.0)


def test_the_end_of_the_study_decides_nothing_and_an_unusable_camera_needs_no_shift() -> None:
    at_the_end = intervals(1.0, 2.5, first_limit=END_OF_STUDY)
    assert _shift_to_decide(at_the_end, (1.0, 2.0)) == pytest.approx(0.2)
    assert _shift_to_decide([], (1.0, 2.0)) == math.inf


def test_an_answer_is_marked_where_the_value_or_an_end_could_reverse_it() -> None:
    assert answer().could_be_overturned(0.12, 0.01)
    assert not answer().could_be_overturned(0.1, 0.01)
    assert answer(end_shift=0.005).could_be_overturned(0.1, 0.01)
    narrow = answer(met=False, unusable=0.02, margin=-0.02, value_margin=0.5, end_shift=0.005)
    assert narrow.could_be_overturned(0.1, 0.01)
    assert not narrow.could_be_overturned(0.1, 0.001)
    assert not replace(narrow, value_margin=-0.5).could_be_overturned(0.1, 0.01), "the value misses its bound anyway"
    assert replace(narrow, value_margin=-0.05).could_be_overturned(0.1, 0.01)


@pytest.mark.parametrize(
    ("camera", "met", "reversible"),
    [("any", True, False), ("any", False, True), ("all", True, True), ("all", False, False)],
)
def test_a_second_camera_can_keep_an_answer_that_the_first_would_lose(camera: str, met: bool, reversible: bool) -> None:
    from tradestudy.answers.requirement_verdicts import _could_be_reversed

    near, far = answer(met=met, end_shift=0.005), answer(met=met, margin=0.5 if met else -0.5)
    if not met:
        near = replace(near, margin=-0.05)
    assert _could_be_reversed(near, [near], camera, 0.1, 0.01)
    assert _could_be_reversed(near, [near, far], camera, 0.1, 0.01) == reversible


def test_a_camera_that_is_nowhere_usable_names_the_first_limit_broken() -> None:
    study = robot(own={"camera": "raytrix-r5", "usable": {"over": ["2 m", "3 m"]}})
    found = check_requirement(part(study, "own"), study.prepared.case, "raytrix-r5", known=())
    assert found.limit == "relative_uncertainty"
    assert found.reason == "not usable from 2 to 3 m: too uncertain"


@pytest.mark.parametrize(
    ("quantity", "met"),
    [
        ({"overlap": {"above": "60 %", "over": ["0.4 m", "3 m"]}}, True),
        ({"overlap": {"above": "99.9 %", "over": ["0.4 m", "3 m"]}}, False),
        ({"lateral_resolution": {"below": "5 mm", "over": ["0.4 m", "3 m"]}}, True),
        ({"lateral_resolution": {"below": "1 mm", "over": ["0.4 m", "3 m"]}}, False),
        ({"failed_fraction": {"below": "1 %", "over": ["0.4 m", "3 m"]}}, True),
        ({"usable": {"over": ["0.4 m", "3 m"]}}, True),
    ],
)
def test_other_quantities_are_bounded_too(quantity: dict[str, Any], met: bool) -> None:
    study = robot(own={"camera": "stereo-75mm", **quantity})
    case, required = study.prepared.case, part(study, "own")
    found = check_requirement(required, case, "stereo-75mm")
    assert found.met is met
    assert is_kept(required, case) is met
    if "overlap" in quantity:  # of parallel views: 1 − f B/(w Z), least at the nearest distance
        width = 1280 * 3e-6
        focus = 2.65e-3 / (1.0 - 2.65e-3)  # the image of 1 m
        assert found.value == pytest.approx(1.0 - focus * 75e-3 / (width * 0.4), rel=1e-3)
        assert found.place == pytest.approx(0.4)
    if "usable" in quantity:
        assert found.margin == pytest.approx(1.0 / 3.0)  # 4 m over 3 m, the nearer end of 0.4/0.3 and 4/3


def test_a_camera_without_overlap_decides_nothing() -> None:
    study = robot(own={"camera": "any", "overlap": {"above": "60 %", "over": ["0.4 m", "3 m"]}})
    one, every = Judge().answer(part(study, "own"), study.prepared.case)
    assert every["raytrix-r5"].met is None
    assert one.met
    assert one.camera.startswith("stereo")


def test_a_camera_that_is_usable_nowhere_in_the_required_range_is_never_the_closest() -> None:
    study = robot(own={"camera": "any", "depth_uncertainty": {"below_relative": "2 %", "over": ["0.4 m", "3 m"]}})
    out_of_focus = {"focus_distance": "30 mm", "depth.disparity_error": "0.1 px"}
    heads = {f"stereo-{base}mm.{name}": value for base in (50, 75) for name, value in out_of_focus.items()}
    study = study.with_values({**heads, "usable_range.blur": "2 px"})
    one, every = Judge().answer(part(study, "own"), study.prepared.case)
    assert [every[f"stereo-{base}mm"].unusable for base in (50, 75)] == [1.0, 1.0]
    array, head = every["raytrix-r5"], every["stereo-75mm"]
    assert array.value_margin is not None
    assert head.value_margin is not None
    # By the sum of both shortfalls alone, the rig would be closer.
    assert array.value_margin - array.unusable < min(head.value_margin, 0.0) - head.unusable
    assert one.camera == "raytrix-r5"


def test_one_camera_without_overlap_leaves_all_undecided_and_an_empty_bound_is_met() -> None:
    over = {"over": ["0.4 m", "3 m"]}
    study = robot(
        every={"camera": "all", "overlap": {"above": "60 %", **over}},
        nothing={"camera": "stereo-75mm", "overlap": {"above": "0 %", **over}},
    )
    one, _ = Judge().answer(part(study, "every"), study.prepared.case)
    assert (one.met, one.camera) == (None, "raytrix-r5")
    assert not is_kept(part(study, "every"), study.prepared.case)
    free = check_requirement(part(study, "nothing"), study.prepared.case, "stereo-75mm")
    assert free.met
    assert free.margin == math.inf
    with pytest.raises(StudyError, match="failed_fraction"):
        robot(own={"camera": "any", "failed_fraction": {"below": "0 %", **over}})


def test_a_usable_range_that_ends_inside_the_required_one_misses_it() -> None:
    study = robot(own={"camera": "raytrix-r5", "usable": {"over": ["0.4 m", "3 m"]}})
    found = check_requirement(part(study, "own"), study.prepared.case, "raytrix-r5")
    assert not found.met
    assert found.margin == pytest.approx(-found.unusable)


@pytest.mark.parametrize(
    ("requirement", "message"),
    [
        ({"camera": "any"}, "exactly one of depth_uncertainty"),
        (
            {"camera": "any", **ONE_PER_CENT, "usable": {"over": ["1 m", "2 m"]}},
            "give exactly one of depth_uncertainty",
        ),
        ({"camera": "all", **ONE_PER_CENT, "guard_band": {}}, "standard_errors and risk"),
        ({"camera": "nobody", **ONE_PER_CENT}, "no camera is called 'nobody'"),
        ({"camera": "any", **ONE_PER_CENT, "priority": "may"}, "must"),
        ({"camera": "any", "usable": {"over": ["1 m", "2 m"]}, "field": "50 %"}, "remove field"),
    ],
)
def test_impossible_requirements_are_refused_at_their_place(requirement: dict[str, Any], message: str) -> None:
    with pytest.raises(StudyError, match=message):
        robot(own=requirement)


def test_the_end_of_an_interval_is_a_root_and_not_a_design() -> None:
    """The threshold of the 75 mm head's baseline, found by direct bisection on the uncertainty at 3 m."""
    study = robot(near={"camera": "stereo-75mm", **ONE_PER_CENT}).with_values(
        {"sweep": {"stereo-75mm.baseline": ["30 mm", "60 mm", "90 mm"]}}
    )
    definition = study.prepared
    found = requirements_group(definition, sweep_points(definition, sweep_axes(definition)), Judge(), Steps())
    low, high = 0.03, 0.09
    while high - low > 1e-6:
        middle = (low + high) / 2.0
        camera = definition.with_values({"stereo-75mm.baseline": f"{middle} m"}).case.cameras["stereo-75mm"]
        low, high = (low, middle) if judged_uncertainty(camera, np.array([3.0]))[0] < 0.03 else (middle, high)
    begins, ends = (float(found[name].values[0, 0]) for name in ("met_from", "met_to"))
    error = float(found["met_to_within"].values[0, 0])
    assert abs(begins - high) <= 2.0 * error + 1e-6
    assert error <= 0.001 * high  # a tenth of the study's 2 %, halved
    assert ends == 0.09
    assert found["design_met"].values[:, 0].tolist() == [0, 1, 1, 1]  # the declared 75 mm among them


def test_where_any_camera_may_meet_it_each_has_its_own_range() -> None:
    """The 50 mm head meets 2 % everywhere, which says nothing about the 75 mm head, whose baseline is swept."""
    two = {"depth_uncertainty": {"below_relative": "2 %", "over": ["0.4 m", "3 m"]}}
    study = robot(any={"camera": "any", **two}, named={"camera": "stereo-75mm", **two})
    definition = study.with_values({"sweep": {"stereo-75mm.baseline": ["20 mm", "60 mm", "90 mm"]}}).prepared
    found = requirements_group(definition, sweep_points(definition, sweep_axes(definition)), Judge(), Steps())
    columns = [found[name].values for name in ("met_camera", "met_from", "met_to")]
    of_any, of_named = (
        {camera: (low, high) for camera, low, high in zip(*(one[k] for one in columns), strict=True) if camera}
        for k in (0, 1)
    )
    assert set(of_any) == {"stereo-75mm", "stereo-50mm"}
    assert of_any["stereo-50mm"] == (0.02, 0.09)
    assert of_any["stereo-75mm"] == of_named["stereo-75mm"]
    assert 0.02 < of_any["stereo-75mm"][0] < 0.06
    assert common_ranges(found, np.array([True, False])) == [(0.02, 0.09)]


def test_processes_give_the_same_bits_and_evaluate_each_camera_once(two_processes: Processes) -> None:
    study = robot(
        any={"camera": "any", **ONE_PER_CENT},
        overlap={"camera": "stereo-75mm", "overlap": {"above": "50 %", "over": ["1 m", "3 m"]}},
    )
    definition = study.with_values({"sweep": {"stereo-75mm.baseline": ["30 mm", "75 mm", "90 mm"]}}).prepared
    designs = sweep_points(definition, sweep_axes(definition))
    steps = Steps(executor=two_processes)
    found = requirements_group(definition, designs, Judge(), steps)
    ranked = ranks_group(definition, steps)
    cameras = {camera for design in designs for camera in design.case.cameras.values()}
    fresh = {camera for camera in cameras if camera not in definition.case.cameras.values()}
    assert steps.counts["requirements"]["computed"] == 2 * len(fresh) < 2 * len(cameras)
    for row, design in enumerate(designs):
        for column, requirement in enumerate(definition.file.requirements.values()):
            one, _ = Judge().answer(requirement, design.case)
            assert found["design_camera"].values[row, column] == one.camera
            assert found["design_margin_percent"].values[row, column] == 100.0 * one.margin
            assert found["design_reason"].values[row, column] == one.reason
    assert steps.counts["ranks"]["computed"] == ranked["rank_first"].values[..., 0].size
    assert ranked.identical(ranks_group(definition, Steps()))


class _TwoStretches:
    """A judge for whom a requirement is met from 2 to 3.3 and from 5.71 to 8 of the parameter."""

    def answer(self, _requirement: object, case: float) -> tuple[RequirementAnswer, dict[str, RequirementAnswer]]:
        met = {"near": 2.0 <= case <= 3.3, "far": 5.71 <= case <= 8.0}
        every = {name: replace(answer(met=one), camera=name) for name, one in met.items()}
        return every["near" if case < 4.0 else "far"], every


def test_a_requirement_can_be_met_on_two_separate_intervals() -> None:
    from types import SimpleNamespace

    from tradestudy.answers.requirement_verdicts import _stretches
    from tradestudy.study.varying import SweepAxis, quantity_entry
    from tradestudy.units import NUMBER

    labels = tuple(float(k) for k in range(1, 11))
    axis = SweepAxis(
        path="x", values=tuple(quantity_entry(one, NUMBER) for one in labels), labels=labels, units="1", declared=1.0,
        dimension=NUMBER,
    )  # fmt: skip
    tolerances = SimpleNamespace(asked=lambda: SimpleNamespace(tolerances={"depth_uncertainty": 0.01}))
    file = SimpleNamespace(requirements={"r": SimpleNamespace(camera="any")}, accuracy=tolerances)
    definition = SimpleNamespace(
        file=file,
        with_values=lambda values: SimpleNamespace(
            case=float(values["x"].value), definition=SimpleNamespace(calibrations_to_infer=dict), file=file
        ),
        definition=SimpleNamespace(calibrations_to_infer=dict),
    )
    judge = _TwoStretches()
    column = [judge.answer(None, one) for one in labels]
    found = _stretches(definition, "r", axis, column, judge)  # type: ignore[arg-type]  # stand-ins
    assert [one.met_camera for one in found] == ["near", "far"]
    np.testing.assert_allclose([one.met_from for one in found], [2.0, 5.71], rtol=1e-3)
    np.testing.assert_allclose([one.met_to for one in found], [3.3, 8.0], rtol=1e-3)
    assert all(one.met_to_within <= 0.0005 * one.met_to for one in found)


def test_nothing_lies_between_two_neighbouring_whole_numbers() -> None:
    """No study has the value in the middle, and the end is exact; if no calibration can be planned there, it is not."""
    from types import SimpleNamespace

    from tradestudy.answers.requirement_verdicts import _root
    from tradestudy.study.varying import SweepAxis, quantity_entry
    from tradestudy.units import NUMBER

    def refuse(_values: object) -> None:
        raise StudyError([])

    def unplanned() -> None:
        raise OutOfRangeError("views that show the target", value="1")

    axis = SweepAxis(
        path="x", values=(quantity_entry(2.0, NUMBER),), labels=(2.0,), units="1", declared=2.0, dimension=NUMBER
    )
    tolerances = SimpleNamespace(asked=lambda: SimpleNamespace(tolerances={"depth_uncertainty": 0.01}))
    definition = SimpleNamespace(file=SimpleNamespace(accuracy=tolerances), with_values=refuse)
    assert _root(definition, "r", axis, (2.0, 3.0), "near", Judge()) == (2.0, 0.0)  # type: ignore[arg-type]  # stand-ins
    no_plan = SimpleNamespace(
        file=definition.file,
        with_values=lambda _: SimpleNamespace(definition=SimpleNamespace(calibrations_to_infer=unplanned)),
    )
    assert _root(no_plan, "r", axis, (2.0, 3.0), "near", Judge()) == (2.0, 0.5)  # type: ignore[arg-type]  # stand-ins


class _Fixed(Judge):
    """A judge who knows the answers of three cameras."""

    def __init__(self, **found: RequirementAnswer) -> None:
        super().__init__()
        self._answers = found

    def _answer_of(self, _requirement: object, _case: object, name: str) -> RequirementAnswer:
        return replace(self._answers[name], camera=name)


@pytest.mark.parametrize(
    ("camera", "answers", "expected"),
    [
        ("all", (False, None), False),  # one that breaks it settles it
        ("all", (True, None), None),
        ("any", (False, None), None),  # the unknown one might keep it
        ("any", (True, None), True),
    ],
)
def test_an_undecided_camera_matters_only_where_the_others_do_not_decide(
    camera: str, answers: tuple[bool | None, ...], expected: bool | None
) -> None:
    study = robot(own={"camera": camera, **ONE_PER_CENT})
    required, case = part(study, "own"), study.prepared.case
    unknown = RequirementAnswer.unknown("", 0.01, "nothing is known")
    known = {
        name: answer(met=bool(met)) if met is not None else unknown for name, met in zip("ab", answers, strict=True)
    }
    case = replace(case, cameras={"a": case.cameras["stereo-50mm"], "b": case.cameras["stereo-75mm"]})
    assert _Fixed(**known).answer(required, case)[0].met is expected


def test_the_bound_itself_does_not_meet_a_strict_bound() -> None:
    at_bound = replace(answer(met=False), margin=0.0, error=0.0)
    assert at_bound.conformity == 0.0
    assert replace(at_bound, met=True).conformity == 1.0


def test_of_cameras_that_miss_the_whole_range_the_better_one_is_nearest() -> None:
    study = robot(own={"camera": "any", **ONE_PER_CENT})
    case = study.prepared.case
    worse = replace(answer(met=False), margin=-1.0, unusable=1.0, value=0.5)
    case = replace(case, cameras={"a": case.cameras["stereo-50mm"], "b": case.cameras["stereo-75mm"]})
    nearest, _ = _Fixed(a=worse, b=replace(worse, value=0.2)).answer(part(study, "own"), case)
    assert nearest.camera == "b"


def test_a_camera_that_misses_the_value_alone_is_nearer_than_one_that_also_has_a_gap() -> None:
    study = robot(own={"camera": "any", **ONE_PER_CENT})
    case = study.prepared.case
    case = replace(case, cameras={"a": case.cameras["stereo-50mm"], "b": case.cameras["stereo-75mm"]})
    gap = replace(answer(met=False), margin=-0.71, value_margin=-0.71, unusable=0.05)
    everywhere = replace(answer(met=False), margin=-0.72, value_margin=-0.72)
    nearest, _ = _Fixed(a=gap, b=everywhere).answer(part(study, "own"), case)
    assert nearest.camera == "b"
    nearest, _ = _Fixed(a=replace(gap, value_margin=-0.5, margin=-0.5), b=everywhere).answer(part(study, "own"), case)
    assert nearest.camera == "a"


def test_where_the_value_falls_shorter_than_the_usable_range_no_limit_decides() -> None:
    study = robot(far={"camera": "raytrix-r5", "depth_uncertainty": {"below": "0.1 mm", "over": ["0.4 m", "1.84 m"]}})
    found = check_requirement(part(study, "far"), study.prepared.case, "raytrix-r5")
    assert 0.0 < found.unusable < -found.margin
    assert found.limit == ""
    assert "1.82 to 1.84 m: " in found.reason


def test_whole_numbers_are_searched_in_whole_numbers() -> None:
    """Met from 6 on, tried at 2 and 11: no study has half an image."""
    from types import SimpleNamespace

    from tradestudy.answers.requirement_verdicts import _root
    from tradestudy.study.varying import SweepAxis, quantity_entry
    from tradestudy.units import NUMBER

    def images(values: dict[str, Any]) -> SimpleNamespace:
        value = values["x"].value
        if not isinstance(value, int):
            raise StudyError([])
        return SimpleNamespace(case=value, definition=SimpleNamespace(calibrations_to_infer=dict), file=file)

    class Six:
        def answer(self, _requirement: object, case: int) -> tuple[RequirementAnswer, dict[str, RequirementAnswer]]:
            return replace(answer(met=case >= 6), camera="near"), {}

    entry = quantity_entry(2.0, NUMBER)
    axis = SweepAxis(path="x", values=(entry,), labels=(2.0,), units="1", declared=2.0, dimension=NUMBER)
    tolerances = SimpleNamespace(asked=lambda: SimpleNamespace(tolerances={"depth_uncertainty": 0.01}))
    file = SimpleNamespace(requirements={"r": SimpleNamespace(camera="any")}, accuracy=tolerances)
    definition = SimpleNamespace(file=file, with_values=images, definition=SimpleNamespace(calibrations_to_infer=dict))
    assert _root(definition, "r", axis, (11.0, 2.0), "near", Six()) == (6.0, 0.0)  # type: ignore[arg-type]  # stand-ins


def test_every_gap_of_the_usable_range_is_named_with_its_limit() -> None:
    """Gaps 0.4 to 0.5 m and 0.6 to 0.8 m for want of overlap, and 2 to 3 m for uncertainty."""
    known = [
        Interval(near=0.5, far=0.6, near_limit="overlap", far_limit="overlap"),
        Interval(near=0.8, far=2.0, near_limit="overlap", far_limit="relative_uncertainty"),
    ]
    study = robot(
        use={"camera": "stereo-75mm", "usable": {"over": ["0.4 m", "3 m"]}},
        depth={"camera": "stereo-75mm", "depth_uncertainty": {"below": "1 m", "over": ["0.4 m", "3 m"]}},
    )
    gaps = (
        "not usable from 0.4 to 0.5 m and from 0.6 to 0.8 m: too little overlap; "
        f"from 2 to 3 m: {limit_words('relative_uncertainty')}"
    )
    used, measured = (
        check_requirement(part(study, name), study.prepared.case, "stereo-75mm", known) for name in ("use", "depth")
    )
    assert used.reason == gaps
    assert measured.reason.startswith(f"{gaps}; worst ")
    share = math.log(0.5 / 0.4) + math.log(0.8 / 0.6) + math.log(3 / 2)
    assert used.unusable == pytest.approx(share / math.log(3 / 0.4))
