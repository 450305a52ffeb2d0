"""Ways of propagation against closed forms of the interval, where they are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import ndtri

from tradestudy.cost import depth_reference, measuring
from tradestudy.cost.depth import INVERSE, LINEAR, MIXED, QUADRATURE, Taken, propagation_cost
from tradestudy.cost.depth_reference import ENDS, DepthCase, reference_of
from tradestudy.cost.entries import PLAIN, SOBOL, CostTable, DrawsSaved, Entry, draws_saved
from tradestudy.cost.measuring import Allowance
from tradestudy.errors import UnaffordableError
from tradestudy.optics.arrays import FloatArray
from tradestudy.uncertainty.distributions import Normal
from tradestudy.uncertainty.error_class import ErrorClass
from tradestudy.uncertainty.evaluation import Outcome
from tradestudy.uncertainty.sources import Source, Sources

DISTANCE = np.array([0.5, 2.0, 5.0])
BASELINE_TIMES_FOCAL_LENGTH = 0.1 * 8e-3
SPREAD = 1.5e-5  # of disparity, at 5 m a tenth of it


def stereo(distance: FloatArray = DISTANCE) -> DepthCase:
    """Depth f B/(d + e), e normal."""

    def model(values: dict[str, FloatArray]) -> Outcome:
        disparity = BASELINE_TIMES_FOCAL_LENGTH / distance + values["e"]
        return Outcome(values=disparity / BASELINE_TIMES_FOCAL_LENGTH)

    normal = Normal(mean=0.0, standard_deviation=SPREAD)
    sources = Sources(groups=(Source(name="e", distribution=normal, error_class=ErrorClass.RIG),))
    return DepthCase(name="s", title="S", model=model, sources=sources, distance=distance)  # type: ignore[arg-type]


def exact_half_width() -> FloatArray:
    """f B/(d₀ + s Φ⁻¹(1 − p)) at both ends."""
    low, high = (
        BASELINE_TIMES_FOCAL_LENGTH / (BASELINE_TIMES_FOCAL_LENGTH / DISTANCE + SPREAD * ndtri(1.0 - p)) for p in ENDS
    )
    return np.asarray((high - low) / 2.0)


@pytest.fixture(scope="module")
def table() -> CostTable:
    patch = pytest.MonkeyPatch()
    patch.setattr(measuring, "_LONG_ENOUGH", 0.0)  # three times each are enough
    try:
        return propagation_cost(
            [stereo()],
            Allowance(seconds=1e4),  # as long as it takes: what is measured is bounded by the draws
            lambda _step, _share: None,
            name="q",
            title="Q",
            says="",
            taken=Taken(model=MIXED, setting="a: b", compute=lambda run: (1.0 + 0.01 * (run % 2)) * exact_half_width()),
            most_draws=2**15,
        )
    finally:
        patch.undo()


def of(table: CostTable, model: str) -> list[Entry]:
    return [entry for entry in table.entries if entry.model == model]


def test_the_line_in_depth_errs_by_what_the_closed_form_says(table: CostTable) -> None:
    (line,) = of(table, LINEAR)
    standard = DISTANCE**2 / BASELINE_TIMES_FOCAL_LENGTH * SPREAD
    expected = np.max(np.abs(standard / exact_half_width() - 1.0))
    assert expected > 5e-3
    assert line.error == pytest.approx(expected, rel=1e-6)  # the line's difference quotients cost it some digits


def test_the_line_in_inverse_depth_is_exact_here(table: CostTable) -> None:
    (line,) = of(table, INVERSE)
    assert line.error < 1e-8


def test_what_a_run_takes_is_chosen_and_errs_by_the_mean_square_of_its_runs(table: CostTable) -> None:
    (own,) = of(table, MIXED)
    assert [entry for entry in table.entries if entry.chosen] == [own]
    assert own.setting == "a: b"
    assert own.error == pytest.approx(0.01 / math.sqrt(2.0), rel=1e-6)  # two of the four runs kept err by 1 %


def test_the_reference_is_within_its_error_of_the_closed_form() -> None:
    found = reference_of([stereo()], Allowance(seconds=1e4), 2**12)
    assert found.relative_error < 1e-10
    assert np.all(np.abs(found.half_width / exact_half_width() - 1.0) <= found.relative_error)
    assert "agree with it" in found.words


def test_without_time_for_integration_draws_are_the_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(depth_reference, "_INTEGRATED", 1e9)
    found = reference_of([stereo()], Allowance(seconds=30.0), 2**12)
    assert "scrambled Sobol draws in" in found.words
    assert np.all(np.abs(found.half_width / exact_half_width() - 1.0) <= 6.0 * found.relative_error)


def test_without_time_for_draws_nothing_is_measured() -> None:
    with pytest.raises(UnaffordableError, match="a larger --budget"):
        reference_of([stereo()], Allowance(seconds=1e-9), 2**12)


def test_plain_draws_err_by_the_standard_error_of_their_quantiles(table: CostTable) -> None:
    """Of a half-width of n normal draws: √(p (1 − p) − p²)/(φ √(2 n)) of it, p = 15.87 %; near enough in depth."""
    density = math.exp(-0.5) / math.sqrt(2.0 * math.pi)
    p = ENDS[0]
    for entry in of(table, PLAIN):
        expected = math.sqrt(p * (1.0 - p) - p * p) / (density * math.sqrt(2.0 * entry.evaluations))
        # Three correlated places and a handful of repeats: a factor of three either way is beyond doubt.
        assert expected / 3.0 < entry.error < 3.0 * expected


@pytest.mark.parametrize(("distance", "endless"), [((2.0, 100.0), 1), ((100.0, 200.0), 2)])
def test_places_without_a_far_end_are_left_out_and_counted(
    distance: tuple[float, ...], endless: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 53 m and beyond one standard deviation of disparity is all of it, and the interval ends at infinity."""
    monkeypatch.setattr(measuring, "_LONG_ENOUGH", 0.0)  # three times each are enough
    found = propagation_cost(
        [stereo(np.array(distance))],
        Allowance(seconds=1e4),
        lambda _step, _share: None,
        name="q",
        title="Q",
        says="",
        taken=Taken(model=MIXED, setting="a: b", compute=lambda _run: np.array(distance) / 50.0),
        most_draws=2**12,
    )
    assert found.left_out[0].startswith(f"{endless} of 2 places")
    assert math.isnan(found.reference_error) == (endless == 2)
    assert bool(found.entries) == (endless == 1)
    assert all(math.isfinite(entry.error) for entry in found.entries)
    # At 2 m r = s Z/f B = 3.75 % of the distance, and half of 1/(1 − r) − 1/(1 + r) is r/(1 − r²).
    said = [
        "What a run takes, what acts in each camera, a: b, errs most for S at 2 m, where the uncertainty is 3.76 % of "
        "the distance."
    ]
    assert [note for note in found.notes if "errs most" in note] == said * bool(found.entries)


def test_sobol_draws_need_at_least_eight_times_fewer_evaluations(table: CostTable) -> None:
    saved = draws_saved(table.entries, table.reference_error)
    assert saved is not None
    assert saved.factor >= 8.0
    assert any("times fewer" in note for note in table.notes)


def test_every_entry_was_timed_and_its_memory_traced(table: CostTable) -> None:
    assert {entry.model for entry in table.entries} == {LINEAR, INVERSE, MIXED, QUADRATURE, SOBOL, PLAIN}
    for entry in table.entries:
        assert 0.0 < entry.least_seconds <= entry.seconds
        assert entry.repeats >= 1
        assert entry.peak_memory > 0.0
    quick = of(table, LINEAR)[0]
    assert quick.repeats >= 3
    most = max(of(table, PLAIN), key=lambda entry: entry.evaluations)
    assert most.peak_memory > 8.0 * most.evaluations  # its draws alone, as doubles


def sampled(model: str, draws: float, error: float) -> Entry:
    return Entry(
        model=model,
        setting="",
        evaluations=draws,
        error=error,
        typical_error=error,
        seconds=1.0,
        least_seconds=1.0,
        peak_memory=1.0,
        repeats=3,
    )


def test_draws_saved_are_read_off_the_lines() -> None:
    entries = [
        *(sampled(SOBOL, n, 1.0 / n) for n in (10.0, 100.0, 1000.0)),
        *(sampled(PLAIN, n, 1.0 / math.sqrt(n)) for n in (100.0, 10_000.0)),
    ]
    saved = draws_saved(entries, 1e-9)
    assert saved is not None
    # 1 % takes 100 Sobol draws and 10 000 plain ones.
    assert saved.error == pytest.approx(0.01)
    assert saved.factor == pytest.approx(100.0, rel=1e-9)
    assert not saved.at_least


def test_what_the_fewest_sobol_draws_undercut_is_a_bound() -> None:
    entries = [
        *(sampled(SOBOL, n, 1e-3 / n) for n in (100.0, 1000.0)),
        *(sampled(PLAIN, n, 1.0 / math.sqrt(n)) for n in (100.0, 10_000.0)),
    ]
    saved = draws_saved(entries, 1e-9)
    assert saved == DrawsSaved(error=pytest.approx(0.01), factor=pytest.approx(100.0), at_least=True)


def test_too_few_measurements_say_nothing() -> None:
    assert draws_saved([sampled(SOBOL, 100.0, 1e-3), sampled(PLAIN, 100.0, 1e-1)], 1e-9) is None
