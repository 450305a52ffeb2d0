"""Trade-offs of a study: what is weighed, which weights are refused, and the designs that nothing beats."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

import tradestudy
from tradestudy.comparison.conclusions import compare_answers, ranks
from tradestudy.depth.evaluation import depth_uncertainty
from tradestudy.errors import StudyError
from tradestudy.report.contents import compose_report
from tradestudy.results import GROUPS
from tradestudy.results.views.trade_off import pareto_front, trade_off_conclusion

STUDIES = Path(__file__).parents[2] / "studies"
POWER = {"worst": "9 W", "best": "1 W", "weight": 0.5}
NEAR = {"quantity": "usable_near", "worst": "1 m", "best": "0.2 m"}
HEADS = ["stereo-50mm", "stereo-75mm"]
MASS = {"worst": "500 g", "best": "100 g"}
ACCURACY = {"quantity": "depth_uncertainty", "at": "1 m", "worst": "20 mm", "best": "1 mm"}


def robot(trade_off: dict[str, Any] | None = None, **values: Any) -> tradestudy.Study:
    study = tradestudy.load(STUDIES / "robot.yaml")
    if trade_off is None:
        return study.with_values(values)
    return study.with_values({"trade_off": None}).with_values({"trade_off": trade_off, **values})


def criteria(study: tradestudy.Study) -> tuple[xr.DataTree, xr.Dataset]:
    tree = study.run().data
    return tree, tree["criteria"].to_dataset()


def test_the_shipped_study_ranks_its_cameras_by_the_weights_it_leaves_open() -> None:
    """Worths of three criteria, integrated over the weights with the first at least 0.3."""
    tree, found = criteria(robot())
    assert set(found.data_vars) <= set(GROUPS["criteria"])
    camera = robot().prepared.case.cameras["stereo-50mm"]
    accuracy = float(found["weighed_value"].sel(candidate="stereo-50mm", weighed="accuracy"))
    assert accuracy == pytest.approx(float(depth_uncertainty(camera, np.array([1.0]))[0]), rel=0.02)
    worth = found["worth"].values
    assert worth[0].tolist() == pytest.approx([(0.02 - accuracy) / 0.019, 0.41 / 0.45, 5.5 / 7.0])
    of_value = found["weighed_value_error"].values[0]
    assert found["worth_error"].values[0].tolist() == pytest.approx([of_value[0] / 0.019, 0.0, 0.0])
    middle = (np.arange(800) + 0.5) / 800
    first, second = (one.ravel() for one in np.meshgrid(0.3 + 0.7 * middle, 0.7 * middle))
    keep = first + second < 1.0
    weights = np.stack([first, second, 1.0 - first - second])[:, keep]
    winner = np.argmax(worth @ weights, axis=0)
    for row in range(3):
        assert float(found["rank_acceptability"][row, 0]) == pytest.approx(np.mean(winner == row), abs=3e-3)
        if (winner == row).any():
            central = weights[:, winner == row].mean(axis=1)
            np.testing.assert_allclose(found["central_weight"].values[row], central, atol=4e-3)
    assert found["central_weight_reason"].values.tolist() == ["", "", "never ranks first"]
    assert found["clipped"].values.tolist() == [[0, 0, 0], [0, 0, 0], [1, 0, 0]]
    assert found["feasible"].values.tolist() == [1, 1, 0]
    assert found["on_pareto_front"].values.tolist() == [1, 1, 0]  # the one more precise, the other lighter
    words = str(compose_report(tree, {}, {}))
    assert words.count("beyond the declared worst or best value") == 1
    assert trade_off_conclusion(tree) in words.replace("\\xa0", " ")


@pytest.mark.parametrize(
    ("trade_off", "path", "message"),
    [
        (
            {"criteria": {"mass": {**MASS, "weight": [0.6, 1]}, "power": POWER}},
            "criteria.power.weight",
            "weights sum to 1.1; all weights sum to 1, so at most 1",
        ),
        (
            {"criteria": {"mass": {**MASS, "weight": [0, 0.3]}, "power": POWER}},
            "criteria.power.weight",
            "weights sum to 0.8; all weights sum to 1, so at least 1",
        ),
        ({"criteria": {"mass": {**MASS, "weight": [0.5, 0.2]}}}, "criteria.mass.weight", "to the largest weight"),
        ({"criteria": {"mas": MASS}}, "criteria.mas", "nearest: 'mass'"),
        ({"criteria": {"mass": {"worst": "1 m", "best": "1 g"}}}, "criteria.mass.worst", "'1 m' is a length"),
        ({"criteria": {"mass": {"worst": "100 g", "best": "0.1 kg"}}}, "criteria.mass.best", "must differ from worst"),
        ({"criteria": {"mass": {"worst": "inf", "best": "1 g"}}}, "criteria.mass.worst", "a finite value is expected"),
        ({"criteria": {"mass": MASS}, "candidates": ["stereo"]}, "candidates.0", "no camera is called 'stereo'"),
        ({"criteria": {"mass": MASS, "accuracy": ACCURACY}, "order": ["mass", "acuracy"]}, "order.1", "'accuracy'"),
        (
            {"criteria": {"mass": {**MASS, "weight": 0.1}, "accuracy": ACCURACY}, "order": ["mass", "accuracy"]},
            "order",
            "'mass' has a weight; give an order or weights",
        ),
        ({"criteria": {"accuracy": {**ACCURACY, "at": None}}}, "criteria.accuracy", "belong together"),
        ({"criteria": {"moving parts": {"worst": 2, "best": 0}}}, "criteria.moving parts", "add relief"),
    ],
)  # fmt: skip
def test_criteria_that_cannot_be_weighed_are_refused_at_their_place(
    trade_off: dict[str, Any], path: str, message: str
) -> None:
    with pytest.raises(StudyError, match=message) as raised:
        robot(trade_off)
    assert raised.value.problems[0].path == f"trade_off.{path}"
    assert raised.value.problems[0].line > 0


def test_a_candidate_without_a_number_or_without_depth_is_named() -> None:
    with pytest.raises(StudyError, match="'raytrix-r5' declares no number for it"):
        robot({"criteria": {"mass": MASS}}, **{"raytrix-r5.attributes.others": {"mass": "light"}})
    lens = tradestudy.load(STUDIES / "hand_lens.yaml")
    with pytest.raises(StudyError, match=r"'mahli' measures no depth; .*usable_near, or name candidates"):
        lens.with_values(
            {"trade_off": {"criteria": {"near": {"quantity": "usable_near", "worst": "1 m", "best": "1 cm"}}}}
        )
    derived = lens.with_values({"trade_off": {"criteria": {"time per scene": {"worst": "60 s", "best": "0 s"}}}})
    with pytest.raises(StudyError, match=r"time per scene: 'mahli' .*no number .*\(one exposure\); leave"):
        derived.plan()


def test_the_front_of_three_swept_numbers_is_that_of_all_feasible_designs() -> None:
    """Every pair of designs compared, from the values and verdicts that the results keep beside it."""
    swept = ("baseline", "lenses.focal_length", "attributes.others.mass")
    study = robot(
        {"criteria": {"accuracy": ACCURACY, "mass": MASS, "near": NEAR}, "candidates": HEADS},
        sweep={
            f"stereo-75mm.{swept[0]}": ["40 mm", "75 mm", "150 mm"],
            f"stereo-75mm.{swept[1]}": ["1.5 mm", "2.65 mm"],
            f"stereo-75mm.{swept[2]}": ["80 g", "115 g"],
        },
        **{"requirements.near-and-mid.depth_uncertainty.below": "3.7 mm"},
    )  # fmt: skip
    tree, found = criteria(study)
    assert (
        found["design_value"].attrs["error"],
        bool((found["design_value_error"].values >= 0.0).all()),
    ) == ("see design_value_error", True)
    values = found["design_value"].values.reshape(-1, 3)
    feasible = found["feasible"].values.ravel() == 1
    assert 0 < feasible.sum() < feasible.size
    # Less is better in all three.
    expected = [
        bool(feasible[i])
        and not any(
            feasible[k] and (values[k] <= values[i]).all() and (values[k] < values[i]).any() for k in range(len(values))
        )
        for i in range(len(values))
    ]
    assert (found["on_pareto_front"].values.ravel() == 1).tolist() == expected
    assert any(expected)
    met = tree["requirements"]["design_met"].values[..., 0]
    assert not (found["feasible"].values == 1)[met != 1].any()
    front = pareto_front(tree, 10)
    assert front is not None
    assert len(front.swept) == 3
    unmoved = sum(expected[0::2]) > 0  # the head that nothing moves counts once
    distinct = {tuple(values[i]) for i in range(1, len(values), 2) if expected[i]}
    assert front.count == len(distinct) + unmoved
    assert "pareto-front" in str(compose_report(tree, {}, {}))
    for one, other in itertools.pairwise(front.designs):
        assert one != other


def test_runs_whose_criteria_favour_another_camera_say_so() -> None:
    """All weight on accuracy favours the one head, all on power the other."""
    found = [
        ranks(robot({"criteria": {name: {**part, "weight": 1.0}}, "candidates": HEADS}).run().data)
        for name, part in (("accuracy", ACCURACY), ("power", POWER))
    ]
    assert compare_answers([found[0], found[0]]) == [None]
    (changed,) = compare_answers(found)
    assert changed is not None
    assert len(set(changed.values)) == 2
