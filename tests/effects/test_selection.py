"""The choice of models against a search by hand, and what it says when nothing fits."""

from __future__ import annotations

import itertools
import math
import re

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tradestudy.accuracy import Accuracy
from tradestudy.effects.base import Bound, EffectCriterion, Model, Slot, SlotName
from tradestudy.effects.selection import Chosen, select, sum_of_seconds
from tradestudy.errors import OutOfRangeError, UnaffordableError


def bound(change: float) -> Bound:
    ratio = EffectCriterion(words="a ratio", definition="one over the other", value=change)
    return Bound(relative_change=change, criterion=ratio, reason="because")


def slot(name: SlotName, *models: tuple[str, float, float]) -> Slot:
    return Slot(
        name=name,
        models=tuple(Model(name=m, bounds={"depth_uncertainty": bound(c)}, seconds=s) for m, c, s in models),
    )


TWO = (
    slot("defocus_blur", ("off", 0.04, 0.0), ("disc", 0.0, 1.0)),
    slot("sensor_noise", ("off", 0.5, 0.0), ("shot", 0.008, 0.5), ("shot+read", 0.0, 3.0)),
)


def test_the_cheapest_set_within_the_accuracy_is_taken() -> None:
    chosen = select(TWO, quantities=("depth_uncertainty",), accuracy=Accuracy.of_all(0.05))
    assert (chosen.name_of("defocus_blur"), chosen.name_of("sensor_noise"), chosen.seconds) == ("off", "shot", 0.5)
    chosen = select(TWO, quantities=("depth_uncertainty",), accuracy=Accuracy.of_all(0.01))
    assert (chosen.name_of("defocus_blur"), chosen.name_of("sensor_noise"), chosen.seconds) == ("disc", "shot", 1.5)


def test_omissions_count_together() -> None:
    """4 % and 0.8 % are each below 4.5 %, their sum is not."""
    chosen = select(TWO, quantities=("depth_uncertainty",), accuracy=Accuracy.of_all(0.045))
    assert (chosen.name_of("defocus_blur"), chosen.name_of("sensor_noise")) == ("disc", "shot")
    why = next(d.why for d in chosen.decisions if d.slot == "defocus_blur" and d.model.name == "off")
    assert "4 %" in why
    assert "4.8 %" in why
    assert [d.seconds for d in chosen.decisions] == [0.5, 1.5, 1.0, 1.5, 4.0]  # each in the place of the one that acts
    spared = {d.model.name: d.why for d in chosen.decisions if d.slot == "sensor_noise" and not d.chosen}
    assert spared["shot+read"].startswith("not needed: ")
    assert spared["shot+read"].endswith("and shot suffices, for 1.5 s in all instead of 4 s")
    hardly = select(TWO, quantities=("depth_uncertainty",), accuracy=Accuracy.of_all(0.0479))
    why = next(d.why for d in hardly.decisions if d.slot == "defocus_blur" and d.model.name == "off")
    assert why.endswith("4.79 % wanted, but with the other omissions 4.8 %")


def test_a_forced_model_stands_and_its_bound_is_told() -> None:
    chosen = select(
        TWO, quantities=("depth_uncertainty",), accuracy=Accuracy.of_all(0.01), forced={"sensor_noise": "off"}
    )
    assert chosen.name_of("sensor_noise") == "off"
    assert chosen.bounds["depth_uncertainty"] == pytest.approx(0.5)
    forced = [d for d in chosen.decisions if d.forced]
    assert [(d.slot, d.model.name) for d in forced] == [("sensor_noise", "off")]
    assert forced[0].why.startswith("forced by the study; ")


def test_what_does_not_fit_the_budget_names_the_nearest_affordable_accuracy() -> None:
    with pytest.raises(UnaffordableError) as error:
        select(TWO, quantities=("depth_uncertainty",), accuracy=Accuracy.of_all(0.01, budget=0.9))
    assert "takes 1.5 s" in str(error.value)
    offer = re.search(r"([\d.]+) % can be had in 0\.5 s", str(error.value))
    assert offer is not None
    offered = Accuracy.of_all(float(offer[1]) / 100.0, budget=0.9)
    assert select(TWO, quantities=("depth_uncertainty",), accuracy=offered).seconds == 0.5


@given(st.floats(1e-5, 1.0))
def test_what_is_offered_can_be_had(change: float) -> None:
    one = (slot("defocus_blur", ("disc", change, 0.0)),)
    wanted = Accuracy.of_all(change / 7.0)
    with pytest.raises(UnaffordableError) as error:
        select(one, quantities=("depth_uncertainty",), accuracy=wanted)
    offer = re.search(r"([\d.e-]+) % can be had", str(error.value))
    assert offer is not None
    offered = float(offer[1]) / 100.0
    assert offered <= 1.11 * change
    assert offered <= 1.0
    select(one, quantities=("depth_uncertainty",), accuracy=Accuracy.of_all(offered))


def test_what_cannot_be_had_names_the_effects_that_stand_in_the_way() -> None:
    slots = (
        slot("crosstalk", ("off", 0.3, 0.0), ("coherent", 0.0081, 1.0)),
        slot("calibration", ("linear", 0.0012, 0.0)),
        slot("spectrum", ("weighted", 0.0002, 0.0)),  # less than a tenth of what remains
        slot("sensor_noise", ("off", 0.2, 0.0)),  # the study insists on it, so that it is held against nothing
    )
    with pytest.raises(UnaffordableError) as error:
        select(
            slots,
            quantities=("psf_width", "depth_uncertainty"),
            accuracy=Accuracy.of_all(0.005),
            forced={"sensor_noise": "off"},
        )
    assert str(error.value) == (
        "the accuracy wanted of the depth uncertainty cannot be had; even the most accurate models leave: 0.95 %, "
        "of which crosstalk (coherent) 0.81 %, calibration (linear) 0.12 % (allowed: 0.5 %); 0.96 % can be had; "
        "ask for that"
    )
    chosen = select(
        slots,
        quantities=("psf_width", "depth_uncertainty"),
        accuracy=Accuracy.of_all(0.0096),
        forced={"sensor_noise": "off"},
    )
    assert chosen.name_of("crosstalk") == "coherent"


def test_each_quantity_that_cannot_be_had_is_offered_what_it_needs() -> None:
    bounds = {"depth_uncertainty": bound(0.0234), "psf_width": bound(0.051), "pixel_intensity": bound(0.001)}
    one = (Slot(name="crosstalk", models=(Model(name="coherent", bounds=bounds),)),)
    asked = ("depth_uncertainty", "psf_width", "pixel_intensity")
    wanted = dict(Accuracy.of_all(0.02).relative)
    with pytest.raises(UnaffordableError) as error:
        select(one, quantities=asked, accuracy=Accuracy(relative=wanted))
    assert str(error.value).startswith("the accuracy wanted of the width of a point's image cannot be had; ")
    assert error.value.remedy == (
        "2.4 % of the depth uncertainty and 5.2 % of the width of a point's image can be had; ask for that"
    )
    offered = Accuracy(relative={**wanted, "depth_uncertainty": 0.024, "psf_width": 0.052})
    assert select(one, quantities=asked, accuracy=offered).bounds["psf_width"] == 0.051


def test_what_has_no_bound_or_one_beyond_the_whole_offers_to_name_models() -> None:
    for change, least in ((math.inf, "no set of models has a finite bound"), (1.2, "not even 100 % can be had")):
        only, wanted = slot("crosstalk", ("off", change, 0.0)), Accuracy.of_all(0.01)
        with pytest.raises(UnaffordableError) as error:
            select((only,), quantities=("depth_uncertainty",), accuracy=wanted)
        assert error.value.remedy == f"{least}; models that a study names under 'effects' are held against no bound"
        assert "of which crosstalk (off) " in error.value.value
        named = select((only,), quantities=("depth_uncertainty",), accuracy=wanted, forced={"crosstalk": "off"})
        assert named.name_of("crosstalk") == "off"


def test_a_budget_below_the_cheapest_set_says_what_that_takes() -> None:
    dear = (slot("crosstalk", ("coherent", 0.0, 2.0)),)
    with pytest.raises(UnaffordableError, match=r"even the cheapest set of models takes 2 s .*; raise the budget"):
        select(dear, quantities=("depth_uncertainty",), accuracy=Accuracy.of_all(0.01, budget=1.0))


def test_models_that_cannot_be_combined_are_never_chosen() -> None:
    chosen = select(
        TWO,
        quantities=("depth_uncertainty",),
        accuracy=Accuracy.of_all(0.05),
        seconds=lambda models: float("inf") if models["defocus_blur"].name == "off" else 1.0,
    )
    assert chosen.name_of("defocus_blur") == "disc"
    assert [d.seconds for d in chosen.decisions if d.slot == "defocus_blur"] == [math.inf, 1.0]


def test_what_cannot_stand_beside_the_others_costs_what_the_cheapest_companion_makes_it() -> None:
    """Rays on both legs or on none: either alone costs what both do."""

    def both_or_none(chosen: Chosen) -> float:
        names = {chosen["main_lens_diffraction"].name, chosen["microlens_diffraction"].name}
        return sum_of_seconds(chosen) if len(names) == 1 else math.inf

    legs: tuple[SlotName, ...] = ("main_lens_diffraction", "microlens_diffraction")
    slots = [slot(leg, ("off", 0.5, 0.25), ("fresnel", 0.0, 4.0)) for leg in legs]
    wanted = Accuracy.of_all(0.01)
    chosen = select(slots, quantities=("depth_uncertainty",), accuracy=wanted, seconds=both_or_none)
    assert [(d.model.name, d.seconds) for d in chosen.decisions] == [("off", 0.5), ("fresnel", 8.0)] * 2
    harmless = [slot(leg, ("off", 0.0, 9.0), ("fresnel", 0.0, 4.0)) for leg in legs]
    chosen = select(harmless, quantities=("depth_uncertainty",), accuracy=wanted, seconds=both_or_none)
    why = next(d.why for d in chosen.decisions if d.model.name == "off")
    assert why == (
        "not taken: changes the depth uncertainty by at most 0 %, 1 % wanted, but it cannot be combined with the other "
        "models that act"
    )


def test_an_unknown_forced_model_is_refused() -> None:
    with pytest.raises(OutOfRangeError, match=r"model of sensor_noise: magic \(allowed: off \| shot \| shot\+read\)"):
        select(TWO, quantities=("depth_uncertainty",), accuracy=Accuracy.of_all(0.01), forced={"sensor_noise": "magic"})


models = st.lists(
    st.tuples(st.floats(0.0, 0.1), st.floats(0.0, 0.1), st.integers(0, 5)), min_size=1, max_size=3
)  # bound on one quantity, on the other, seconds


@settings(max_examples=60, deadline=None)
@given(table=st.lists(models, min_size=1, max_size=4), wanted=st.floats(0.01, 0.3))
def test_the_choice_is_a_search_by_hand(table: list[list[tuple[float, float, int]]], wanted: float) -> None:
    names: tuple[SlotName, ...] = ("defocus_blur", "crosstalk", "spectrum", "vignetting")
    slots = [
        Slot(
            name=name,
            models=tuple(
                Model(name=str(i), bounds={"depth_uncertainty": bound(a), "psf_width": bound(b)}, seconds=float(s))
                for i, (a, b, s) in enumerate(rows)
            ),
        )
        for name, rows in zip(names, table, strict=False)
    ]
    fitting = [
        sum(row[2] for row in rows)
        for rows in itertools.product(*table)
        if max(sum(row[0] for row in rows), sum(row[1] for row in rows)) <= wanted * (1 - 1e-12)
    ]
    try:
        chosen = select(slots, quantities=("depth_uncertainty", "psf_width"), accuracy=Accuracy.of_all(wanted))
    except UnaffordableError:
        assert not fitting
    else:
        assert max(chosen.bounds.values()) <= wanted * (1 + 1e-9)
        assert not fitting or chosen.seconds <= min(fitting)
        for decision in chosen.decisions:
            own = chosen.chosen[decision.slot]
            assert decision.seconds == chosen.seconds - own.seconds + decision.model.seconds
            if decision.seconds < chosen.seconds:  # what is cheaper was not left aside for nothing
                assert decision.why.startswith("refused: ")
