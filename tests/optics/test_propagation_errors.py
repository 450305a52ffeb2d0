"""Stated errors, refusals, and rays."""

from __future__ import annotations

import importlib.util
import math
import sys
import time
from pathlib import Path

import mpmath
import numpy as np
import pytest

from tradestudy.errors import NotConvergedError, OutOfRangeError, UnaffordableError
from tradestudy.optics.arrays import unit_phasor
from tradestudy.optics.chain.accuracy import relative_change
from tradestudy.optics.propagation import wave_optics
from tradestudy.optics.propagation.aperture import aperture_field, lens_wave
from tradestudy.optics.propagation.kernels import ApertureSamples, FresnelKernel, KirchhoffKernel
from tradestudy.optics.propagation.lens import CircularLens, PointSource
from tradestudy.optics.propagation.result import ApertureField, NumericalError, choose_check_targets
from tradestudy.optics.propagation.sampling import Limits, NodeCounts
from tradestudy.optics.propagation.targets import TargetGrid, TargetPoints
from tradestudy.optics.propagation.wave_optics import (
    FieldAccuracy,
    nodes_for,
    propagate_samples,
    propagate_wave,
    sample_wave,
)
from tradestudy.optics.quadrature import disc_nodes

MAIN = CircularLens(radius=12.5e-3 / 7.6, focal_length=12.5e-3, lens_phase="parabolic")
SOURCE = PointSource(x=1e-3, distance=0.15)


def load_cases():
    path = Path(__file__).parents[1] / "benchmarks" / "aperture_cases.py"
    spec = importlib.util.spec_from_file_location("aperture_cases", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def test_unit_phasors_are_right_to_rounding_at_every_phase():
    near = np.concatenate([np.pi * np.arange(-9, 10) + step for step in (0.0, 1e-15, -1e-15, 1e-9, 0.5 * np.pi)])
    far = np.random.default_rng(0).normal(size=1000) * np.logspace(-9, 10, 1000)
    for phase in np.concatenate([near, far, [0.0, -0.0]]):
        with mpmath.workdps(40):
            exact = complex(mpmath.expj(mpmath.mpf(float(phase))))
        assert abs(unit_phasor(np.array([phase]))[0] - exact) < 5e-16


def test_stated_errors_hold_and_are_not_far_above_on_random_cameras():
    """A sample of tests/benchmarks/aperture_audit.py, which runs 200."""
    cases = load_cases()
    rng = np.random.default_rng(2024)
    ratio = []
    for _ in range(20):
        case = cases.random_case(rng, most_nodes=3000)
        result = cases.run(case)
        assert result.error.intensity <= case.accuracy.tolerance
        ratio.append(result.error.intensity / cases.true_error(case, result))
    # 95 % coverage lets 3 of 20 pass below 1 with probability 0.98.
    assert np.count_nonzero(np.asarray(ratio) < 1) <= 3
    assert np.median(ratio) <= 10


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_with_too_few_nodes_the_stated_error_grows_with_the_true_one(seed: int):
    cases = load_cases()
    rng = np.random.default_rng(seed)
    case = cases.random_case(rng, most_nodes=3000)
    full = cases.run(case)
    for share in (0.5, 0.25):
        poor = cases.run(case, node_share=share)
        true = cases.true_error(case, poor)
        if true > full.error.intensity:
            assert poor.error.intensity > full.error.intensity
            assert poor.error.intensity > 0.3 * min(true, 1.0)
        assert poor.effort.nodes < 0.6 * full.effort.nodes


def test_nodes_follow_from_the_slope_and_are_refused_when_too_many():
    far = TargetGrid.centred(centre=(0.0, 0.0), pitch=10e-6, count=400, distance=3e-3)
    with pytest.raises(UnaffordableError) as refusal:
        aperture_field(
            source=SOURCE,
            lens=MAIN,
            targets=far,
            wavelength=550e-9,
            method="kirchhoff",
            accuracy=FieldAccuracy(tolerance=1e-3),
            limits=Limits(nodes=1_000_000),
        )
    assert refusal.value.exit_status == 2
    for word in ("nodes", "bytes", "limits", "1000000"):
        assert word in str(refusal.value)
    kernel = KirchhoffKernel(wavelength=550e-9, obliquity="paper")
    wave = lens_wave(source=SOURCE, lens=MAIN, wavelength=550e-9)
    # k R sin θ turns of a ring, per the steepest ray: the count grows in proportion.
    counts = [
        nodes_for(wave, kernel, TargetPoints(x=x, y=0.0, distance=13.7e-3), FieldAccuracy(tolerance=1e-6))
        for x in (1e-3, 2e-3)
    ]
    expected = 2 * math.pi / 550e-9 * MAIN.radius * 1e-3 / math.hypot(13.7e-3, 1.5e-3)
    assert counts[1].angular - counts[0].angular == pytest.approx(expected, rel=0.08)


def test_limits_of_memory_and_time_are_kept_too():
    targets = TargetGrid.centred(centre=(0.0, 0.0), pitch=0.25e-6, count=128, distance=13.6e-3)
    for limits in (Limits(memory_bytes=1e6), Limits(seconds=1e-3)):
        with pytest.raises(UnaffordableError, match="limits=Limits"):
            aperture_field(
                source=SOURCE,
                lens=MAIN,
                targets=targets,
                wavelength=550e-9,
                method="kirchhoff",
                accuracy=FieldAccuracy(tolerance=1e-6),
                limits=limits,
            )


def test_no_error_is_stated_for_nodes_that_twice_as_many_contradict():
    """Beside the image, in the dark, starved nodes and twice as many both invent light, and by thousands of times."""
    image = MAIN.image_of(SOURCE)
    targets = TargetGrid.centred(centre=(image[0] + 0.1e-3, 0.0), pitch=0.5e-6, count=24, distance=image[2])
    settings = {
        "source": SOURCE, "lens": MAIN, "targets": targets, "wavelength": 550e-9, "method": "kirchhoff",
        "accuracy": FieldAccuracy(tolerance=1e-6),
    }  # fmt: skip
    truth = aperture_field(**settings)
    for share in (0.3, 0.2, 0.1):
        counts = NodeCounts(
            radial=int(share * truth.effort.radial_nodes), angular=int(share * truth.effort.angular_nodes)
        )
        starved = aperture_field(**settings, counts=counts)
        assert relative_change(truth.intensity, starved.intensity) > 100.0
        assert starved.error.intensity == starved.error.field == math.inf
        assert starved.error.nodes >= 1.0


def test_the_stated_error_keeps_growing_with_fewer_nodes():
    """Where too few nodes invent light, errors count against the light that there is: no statement stops near 4."""
    arguments = {
        "source": PointSource(distance=0.15),
        "lens": MAIN,
        "targets": TargetGrid.centred(centre=(0.0, 0.0), pitch=1e-6, count=65, distance=13.0e-3),
        "wavelength": 550e-9,
        "method": "kirchhoff",
    }
    truth = aperture_field(**arguments, accuracy=FieldAccuracy(tolerance=1e-6)).intensity
    for count in (7, 8, 9):
        starved = aperture_field(
            **arguments,
            accuracy=FieldAccuracy(tolerance=1e-3),
            counts=NodeCounts(radial=count, angular=2 * count),
        )
        true = np.linalg.norm(starved.intensity - truth) / np.linalg.norm(truth)
        assert true > 1.0
        assert starved.error.intensity > max(0.3 * true, 10.0)


def test_the_time_limit_includes_refinement():
    """Each round takes a quarter of a second and is not enough: the third would end too late."""
    wave = lens_wave(source=SOURCE, lens=MAIN, wavelength=550e-9)
    asked = []

    def slow(counts):
        asked.append(counts)
        time.sleep(0.125)  # once for the result and once for its check
        return sample_wave(wave, counts)

    with pytest.raises(UnaffordableError, match=r"refinement that the tolerance needs.*0\.6 s"):
        propagate_wave(
            sample=slow,
            counts=NodeCounts(radial=4, angular=8),
            kernel=KirchhoffKernel(wavelength=550e-9, obliquity="paper"),
            targets=TargetGrid.centred(centre=(0.0, 0.0), pitch=1e-6, count=9, distance=13.0e-3),
            accuracy=FieldAccuracy(tolerance=1e-6),
            limits=Limits(seconds=0.6),
        )
    assert len(asked) <= 4  # five rounds would ask for ten


def attempt(**changes):
    arguments = {
        "source": SOURCE,
        "lens": MAIN,
        "targets": TargetPoints(x=0.0, y=0.0, distance=13.6e-3),
        "wavelength": 550e-9,
        "method": "kirchhoff",
        "accuracy": FieldAccuracy(tolerance=1e-3),
    }
    return aperture_field(**(arguments | changes))


@pytest.mark.parametrize(
    ("make", "word"),
    [
        (lambda: attempt(wavelength=2.1 * MAIN.radius), "at most the width of the aperture"),
        (lambda: attempt(targets=TargetPoints(x=0.0, y=0.0, distance=500e-9)), "at least one wavelength"),
        (lambda: attempt(method="fraunhofer"), "method"),
        (lambda: attempt(wavelength=0.0), "wavelength"),
        (lambda: attempt(wavelength=math.nan), "wavelength"),
        (lambda: attempt(obliquity="none"), "obliquity"),
        (lambda: attempt(method="fresnel", obliquity="textbook"), "Fresnel"),
        (lambda: attempt(method="geometric", counts=NodeCounts(radial=3, angular=3)), "rays"),
        (lambda: PointSource(distance=0.0), "source"),
        (lambda: PointSource(x=math.inf, distance=1.0), "source"),
        (lambda: CircularLens(radius=0.0, focal_length=1.0, lens_phase="perfect"), "radius"),
        (lambda: CircularLens(radius=1.0, focal_length=0.0, lens_phase="perfect"), "focal_length"),
        (lambda: CircularLens(radius=1.0, focal_length=1.0, lens_phase="ideal"), "lens_phase"),
        (lambda: CircularLens(radius=1.0, focal_length=1.0, lens_phase="stigmatic"), "focus_distance"),
        *(
            (
                lambda focus=focus: CircularLens(
                    radius=1.0, focal_length=1.0, lens_phase="stigmatic", focus_distance=focus
                ),
                "focus_distance of a stigmatic lens.*finite",
            )
            for focus in (math.inf, math.nan, 0.0)
        ),
        (
            lambda: CircularLens(radius=1.0, focal_length=1.0, lens_phase="perfect", focus_distance=2.0),
            "focus_distance",
        ),
        (
            lambda: attempt(
                lens=CircularLens(radius=1e-3, focal_length=0.15, lens_phase="perfect"),
                source=PointSource(distance=0.15),
            ),
            "focal plane",
        ),
        (lambda: TargetPoints(x=0.0, y=0.0, distance=-1.0), "targets"),
        (lambda: TargetPoints(x=[], y=[], distance=1.0), "targets"),
        (lambda: TargetGrid.centred(centre=(0.0, 0.0), pitch=1.0, count=0, distance=1.0), "grid"),
        (lambda: TargetGrid.centred(centre=(0.0, 0.0), pitch=0.0, count=2, distance=1.0), "pitch"),
        (lambda: FieldAccuracy(tolerance=1e-12), "tolerance"),
        (lambda: FieldAccuracy(tolerance=1e-3, check_targets=0), "check_targets"),
        (lambda: NodeCounts(radial=0, angular=4), "node counts"),
    ],
)
def test_meaningless_arguments_are_refused(make, word: str):
    with pytest.raises(OutOfRangeError, match=word):
        make()


def test_arrays_on_an_aperture_are_checked():
    nodes = disc_nodes(radius=1e-4, radial_count=4, angular_count=8)
    targets, accuracy = TargetPoints(x=0.0, y=0.0, distance=1e-3), FieldAccuracy(tolerance=1e-3)
    with pytest.raises(OutOfRangeError, match="shape"):
        ApertureSamples(nodes=nodes, field=np.ones(3, dtype=complex))
    with pytest.raises(OutOfRangeError, match="finite"):
        ApertureSamples(nodes=nodes, field=np.full(32, np.nan, dtype=complex))
    with pytest.raises(OutOfRangeError, match="textbook"):
        propagate_samples(
            samples=ApertureSamples(nodes=nodes, field=np.ones(32, dtype=complex)),
            kernel=KirchhoffKernel(wavelength=550e-9, obliquity="textbook"),
            targets=targets,
            accuracy=accuracy,
        )


def test_an_array_and_its_wave_give_the_same_field():
    """The building block of a chain: samples in, field out, about the centre of its own lens."""
    lens = CircularLens(radius=50e-6, focal_length=0.43e-3, lens_phase="perfect", centre=(126e-6, -40e-6))
    source = PointSource(x=0.2e-3, y=0.0, distance=-1.6e-3)  # light that converges behind the lens
    grid = TargetGrid.centred(centre=(126e-6, -40e-6), pitch=1e-6, count=30, distance=0.5e-3)
    accuracy = FieldAccuracy(tolerance=1e-7)
    whole = aperture_field(
        source=source, lens=lens, targets=grid, wavelength=550e-9, method="kirchhoff", accuracy=accuracy
    )
    counts = NodeCounts(radial=whole.effort.radial_nodes, angular=whole.effort.angular_nodes)
    kernel = KirchhoffKernel(wavelength=550e-9, obliquity="paper")
    samples = sample_wave(lens_wave(source=source, lens=lens, wavelength=550e-9), counts)
    part = propagate_samples(samples=samples, kernel=kernel, targets=grid, accuracy=accuracy)
    scale = np.abs(whole.field).max()
    np.testing.assert_allclose(part.field, whole.field, atol=1e-7 * scale)
    assert part.error.check < 1e-6
    assert np.isnan([part.error.field, part.error.intensity]).all()  # whether the nodes suffice is not known
    # 1/b = 1/f − 1/a with a < 0 puts the focus at 0.339 mm, on the line through the vertex.
    b = 1 / (1 / 0.43e-3 + 1 / 1.6e-3)
    focus = aperture_field(
        source=source,
        lens=lens,
        targets=TargetGrid.centred(
            centre=(126e-6 + 74e-6 * b / 1.6e-3, -40e-6 + 40e-6 * b / 1.6e-3), pitch=0.2e-6, count=31, distance=b
        ),
        wavelength=550e-9,
        method="kirchhoff",
        accuracy=accuracy,
    ).intensity
    assert np.unravel_index(np.argmax(focus), focus.shape) == (15, 15)


def off_axis(tolerance: float) -> ApertureField:
    """A plane wave behind an aperture, at targets so far beside it that sums need more accuracy than at first."""
    nodes = disc_nodes(radius=0.5e-3, radial_count=60, angular_count=120)
    return propagate_samples(
        samples=ApertureSamples(nodes=nodes, field=np.ones(nodes.count, dtype=complex)),
        kernel=FresnelKernel(wavelength=550e-9),
        targets=TargetGrid.centred(centre=(3e-3, 0.0), pitch=2e-6, count=64, distance=20e-3),
        accuracy=FieldAccuracy(tolerance=tolerance),
    )


def test_sums_over_given_samples_are_refined():
    field = off_axis(1e-6)
    assert field.effort.rounds == 2
    assert field.effort.nodes == 60 * 120
    assert field.error.check < 0.25e-6


def test_sums_that_rounding_limits_are_refused_with_the_nodes_that_were_given(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(NotConvergedError, match="with 7200 nodes"):
        off_axis(1e-10)
    # Where nothing can be refined further, the same round is not repeated.
    rounds: list[float] = []

    def never(_intensity: object, _check: object, *, nufft: float, **_: float) -> NumericalError:
        rounds.append(nufft)
        return NumericalError(field=1.0, intensity=math.inf, nodes=math.nan, low_rank=0.0, nufft=nufft, check=1.0)

    monkeypatch.setattr(wave_optics, "stated_error", never)
    with pytest.raises(NotConvergedError):
        off_axis(1e-6)
    assert len(rounds) == len({*rounds}) == 2


def test_rays_carry_the_power_of_the_aperture():
    lens = CircularLens(radius=56.8e-6, focal_length=0.432e-3, lens_phase="parabolic")
    source = PointSource(x=0.3e-3, y=0.2e-3, distance=13.64e-3)
    distance = 0.7e-3
    nodes = disc_nodes(radius=lens.radius, radial_count=12, angular_count=24)
    wave = lens_wave(source=source, lens=lens, wavelength=550e-9)
    through = float(np.sum(nodes.weights * np.abs(wave.amplitude(nodes.x, nodes.y)) ** 2))
    grid = TargetGrid.centred(
        centre=(-0.3e-3 * distance / 13.64e-3, -0.2e-3 * distance / 13.64e-3),
        pitch=0.25e-6,
        count=400,
        distance=distance,
    )
    result = aperture_field(
        source=source,
        lens=lens,
        targets=grid,
        wavelength=550e-9,
        method="geometric",
        accuracy=FieldAccuracy(tolerance=1e-8),
    )
    # Counting pixels of a hard-edged disc of 130 pixels' radius: 1e-3 at worst.
    assert float(result.intensity.sum()) * 0.25e-6**2 == pytest.approx(through, rel=1e-3)
    assert result.error.intensity < 1e-8


def test_rays_behind_a_caustic_are_all_found():
    """On the axis between the marginal and the paraxial focus: one axial ray and a cone, an infinite intensity."""
    lens = CircularLens(radius=12.5e-3 / 7.6, focal_length=12.5e-3, lens_phase="parabolic")
    axial = PointSource(distance=0.15)
    _, _, b = lens.image_of(axial)
    # A ray from radius r crosses the axis at z(r): from eq. of the parabola, p = r/f − r/√(a² + r²).
    r = np.linspace(0.05, 1.0, 4000) * lens.radius
    p = r / 12.5e-3 - r / np.hypot(0.15, r)
    z = 0.5 * (r * np.sqrt(1 - p**2) / p).min() + 0.5 * b
    x = 0.3e-6
    # By tracing: how many times does the fan of rays in the plane of x pass the target?
    fan = np.linspace(-1.0, 1.0, 200_001) * lens.radius
    slope = fan / np.hypot(0.15, fan) - fan / 12.5e-3
    landed = fan + z * slope / np.sqrt(1 - slope**2) - x
    crossings = np.flatnonzero(np.diff(np.sign(landed)) != 0)
    derivative = np.gradient(landed, fan)[crossings]
    sagittal = 1 + z * slope[crossings] / np.sqrt(1 - slope[crossings] ** 2) / fan[crossings]
    amplitude = 0.15 / (550e-9 * (0.15**2 + fan[crossings] ** 2))
    expected = float(np.sum(amplitude**2 / np.abs(derivative * sagittal)))
    found = attempt(
        source=axial,
        lens=lens,
        targets=TargetPoints(x=x, y=0.0, distance=z),
        method="geometric",
        accuracy=FieldAccuracy(tolerance=1e-3),
    )
    assert crossings.size == 3
    assert float(found.intensity) == pytest.approx(expected, rel=1e-3)


def test_rays_of_a_perfect_lens_in_focus_and_outside_the_shadow():
    lens = CircularLens(radius=1e-3, focal_length=12.5e-3, lens_phase="perfect")
    _, _, b = lens.image_of(PointSource(distance=0.15))
    targets = TargetPoints(x=[0.0, 1e-6, 0.0, 1e-3], y=0.0, distance=[b, b, b + 1e-4, b + 1e-4])
    result = attempt(source=PointSource(distance=0.15), lens=lens, targets=targets, method="geometric")
    assert math.isinf(result.intensity[0])
    assert result.intensity[1] == 0.0
    assert result.intensity[2] == pytest.approx((1 / (550e-9 * 0.15) * b / 1e-4) ** 2, rel=1e-9)
    assert result.intensity[3] == 0.0


def test_darkness_is_refused_as_a_result():
    """So far from the image that rounding of the light in focus is all there is: refused, with the remedy."""
    lens = CircularLens(radius=56.8e-6, focal_length=0.432e-3, lens_phase="perfect")
    source = PointSource(distance=13.64e-3)
    with pytest.raises(NotConvergedError, match="dark"):
        attempt(
            source=source,
            lens=lens,
            targets=TargetPoints(x=[0.31e-3, 0.32e-3], y=0.0, distance=lens.image_of(source)[2]),
            accuracy=FieldAccuracy(tolerance=1e-10),
        )


def test_check_targets_represent_all_even_where_a_few_hold_the_light() -> None:
    """Means over them are unbiased; no draw falls twice on a target that holds nearly everything."""
    grid = TargetGrid.centred(centre=(0.0, 0.0), pitch=1e-6, count=21, distance=0.01)
    rng = np.random.default_rng(8)
    intensity = 1e-6 * rng.random(21 * 21)
    intensity[[220, 219, 221, 199]] = 1.0, 0.02, 0.01, 0.01
    squares = rng.random(intensity.size) * (1.0 + 50.0 * intensity)
    found = []
    for seed in range(600):
        at = choose_check_targets(grid, intensity, count=16, seed=seed)
        assert {220, 219, 221, 199} <= set(at.index[:16].tolist())
        found.append(float(np.mean((at.weight * squares[at.index])[~at.corner])))
    assert np.mean(found) == pytest.approx(squares.mean(), abs=4.0 * np.std(found) / math.sqrt(600))


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 10))])
def test_a_coarse_grid_over_a_focus_states_the_errors_beside_the_brightest_target(seed: int) -> None:
    """At the brightest target, with a twentieth of the light in all others, the nodes happen to do well."""
    case = load_cases().Case(
        source=PointSource(x=5.11e-5, y=3.689e-4, distance=3.086e-3),
        lens=CircularLens(radius=3.157e-5, focal_length=3.246e-4, lens_phase="perfect"),
        targets=TargetGrid(
            x_start=-8.75e-5,
            y_start=-1.22e-4,
            x_pitch=7.934e-6,
            y_pitch=7.934e-6,
            x_count=22,
            y_count=22,
            distance=3.6277e-4,
        ),
        wavelength=656.2e-9,
        method="kirchhoff",
        obliquity="textbook",
        accuracy=FieldAccuracy(tolerance=5e-7, seed=seed),
    )
    found = load_cases().run(case)
    assert load_cases().true_error(case, found) <= found.error.intensity <= 5e-7
