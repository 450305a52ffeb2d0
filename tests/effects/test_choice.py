"""The choice of models against a search by hand, on problems whose changes are known."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tradestudy.effects import EFFECTS, Models, SlotName, models_of
from tradestudy.errors import OutOfRangeError, UnaffordableError
from tradestudy.models.problem import Change, Changes, Choice, SimulationProblem, Slot, choose

TOLERANCE = {"depth_uncertainty": 0.05}


class Known(SimulationProblem):
    """A problem whose omissions add up; some are known only within a factor until they are tried."""

    name, title = "known", "A known problem"
    asked = ("depth_uncertainty",)

    def __init__(
        self,
        slots: Mapping[SlotName, Mapping[str, float]],
        *,
        wide: float = 1.0,
        costly: Mapping[SlotName, int] = MappingProxyType({}),
    ) -> None:
        self.slots = tuple(
            Slot(name=name, models=tuple(models), costly=costly.get(name, 0)) for name, models in slots.items()
        )
        self._of, self.wide, self.tried = slots, wide, 0

    def changes(self, models: Models) -> Changes:
        total = math.fsum(self._of[slot][model] for slot, model in models.items())  # type: ignore[index]
        return {"depth_uncertainty": Change(relative=total * self.wide, least=total / self.wide, evidence="rule")}

    def try_out(self, models: Models) -> bool:
        self.tried += 1
        known, self.wide = self.wide > 1.0, 1.0
        return known


def blur_and_noise(**more: Any) -> Known:
    return Known(
        {
            "main_lens_diffraction": {"off": 0.2, "airy": 0.04, "fresnel": 0.001, "kirchhoff": 0.0},
            "calibration": {"off": 0.5, "linear": 0.02, "exact": 0.0},
        },
        **more,
    )


def names(choice: Choice) -> tuple[str, ...]:
    return tuple(choice.models.values())


def test_the_simplest_models_that_fit_together_are_taken() -> None:
    assert names(choose(blur_and_noise(), {"depth_uncertainty": 0.05}, {})) == ("airy", "exact")
    assert names(choose(blur_and_noise(), {"depth_uncertainty": 0.06}, {})) == ("airy", "linear")
    assert names(choose(blur_and_noise(), {"depth_uncertainty": 0.03}, {})) == ("fresnel", "linear")
    assert names(choose(blur_and_noise(), {"depth_uncertainty": 1.0}, {})) == ("off", "off")
    assert names(choose(blur_and_noise(), {"depth_uncertainty": 1e-4}, {})) == ("kirchhoff", "exact")


def test_a_cheap_omission_does_not_use_up_the_tolerance_that_saves_a_costly_model() -> None:
    """With Airy's law (4 %), draws would remain necessary; with Fresnel's (0.1 %), a line (2 %) suffices instead."""
    costly = blur_and_noise(costly={"main_lens_diffraction": 1, "calibration": 2})
    assert names(choose(costly, {"depth_uncertainty": 0.05}, {})) == ("fresnel", "linear")
    assert names(choose(costly, {"depth_uncertainty": 0.0205}, {})) == ("kirchhoff", "linear"), "draws cost the most"
    assert names(choose(costly, {"depth_uncertainty": 0.06}, {})) == ("airy", "linear")
    assert names(choose(costly, {"depth_uncertainty": 1.0}, {})) == ("off", "off")


def test_only_what_can_change_the_choice_is_tried() -> None:
    """A rule that is three times too wide decides alone where even a third of it is too much, or all of it is not."""
    clear = blur_and_noise(wide=3.0)
    choice = choose(clear, {"depth_uncertainty": 3.0}, {})
    assert (names(choice), clear.tried) == (("off", "off"), 0)
    refused = blur_and_noise(wide=3.0)
    choice = choose(refused, {"depth_uncertainty": 1e-4}, {})
    assert (names(choice), refused.tried) == (("kirchhoff", "exact"), 0)
    near = blur_and_noise(wide=3.0)
    choice = choose(near, {"depth_uncertainty": 0.06}, {})
    assert (names(choice), near.tried) == (("airy", "linear"), 1)


def test_every_model_is_listed_with_the_change_that_it_alone_causes() -> None:
    choice = choose(blur_and_noise(), {"depth_uncertainty": 0.06}, {})
    alone = {(one.slot, one.model): one.changes["depth_uncertainty"].relative for one in choice.decisions}
    assert alone["main_lens_diffraction", "airy"] == 0.04
    assert alone["calibration", "linear"] == 0.02
    assert choice.changes["depth_uncertainty"].relative == pytest.approx(0.06)
    assert [one.model for one in choice.decisions if one.chosen] == ["airy", "linear"]


def test_a_tolerance_beyond_the_most_complete_models_is_refused_with_value_limit_and_remedy() -> None:
    coarse = Known({"sampling": {"5 %": 0.05, "1 %": 0.01}})
    with pytest.raises(
        UnaffordableError, match=r"A known problem: .*depth uncertainty.*1 %.*0\.1 %.*loosen the tolerance"
    ):
        choose(coarse, {"depth_uncertainty": 0.001}, {})


def test_a_slot_without_models_or_with_two_of_one_name_is_refused() -> None:
    for models in ((), ("off", "off")):
        with pytest.raises(OutOfRangeError):
            Slot(name="spectrum", models=models)


def test_every_effect_can_be_left_out_but_noise_and_has_a_use() -> None:
    """Without noise a matcher makes no error, and there is no depth uncertainty to speak of."""
    for effect in EFFECTS:
        models = models_of(effect)
        assert (models[0] == "off") == (effect != "sensor_noise")
        assert len(models) > 1
        used = [models_of(effect, use) for use in ("depth", "sharpness", "spot", "point")]
        assert set(models) == set(itertools.chain(*used))


@settings(max_examples=200, deadline=None)
@given(
    st.lists(
        st.lists(st.floats(0.0, 0.2), min_size=1, max_size=3).map(lambda changes: sorted(changes, reverse=True)),
        min_size=1,
        max_size=4,
    ),
    st.floats(1e-3, 0.5),
)
def test_no_single_model_of_the_choice_could_be_simpler(table: list[list[float]], tolerance: float) -> None:
    """What is chosen fits, and fits no more with any one model replaced by a simpler one."""
    slots = {
        slot: {**{str(k): change for k, change in enumerate(changes)}, "complete": 0.0}
        for slot, changes in zip(EFFECTS, table, strict=False)
    }
    choice = choose(Known(slots), {"depth_uncertainty": tolerance}, {})

    def total(models: Models) -> float:
        return math.fsum(slots[slot][model] for slot, model in models.items())

    assert total(choice.models) <= tolerance
    for slot, model in choice.models.items():
        simpler = list(slots[slot])[: list(slots[slot]).index(model)]
        assert all(total({**choice.models, slot: one}) > tolerance for one in simpler)
