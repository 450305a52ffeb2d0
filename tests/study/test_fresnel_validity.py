"""Fresnel against Kirchhoff: errors, criteria and claims against published and independently computed numbers."""

from __future__ import annotations

import html
import math
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.special import j0

import tradestudy
from tradestudy.api import Result
from tradestudy.errors import OutOfRangeError, StudyError
from tradestudy.models.point_spreads import limit_f_number, varied_values
from tradestudy.optics.psf_difference import fresnel_psf_difference
from tradestudy.report.sections.fresnel_validity import _from_f_number
from tradestudy.study.schema.wave_optics import listed

STUDY = Path(__file__).parents[2] / "studies" / "fresnel_validity.yaml"
MAIN = {"focal_length": 12.5e-3, "object_distance": 0.150}
MICRO = {"focal_length": 0.432e-3, "object_distance": 13.64e-3}
Intensities = tuple[np.ndarray, np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def result() -> Result:
    """The study with fewer f-numbers, wavelengths and windows, on the axis; the claims as they are."""
    fewer = ["f_numbers.points=5", "off_axis=null", "windows=[10]", "wavelengths=[450 nm, 550 nm]"]
    phases = "lens_phases=[parabolic, perfect]"
    return tradestudy.load(STUDY, [f"fresnel_validity.{one}" for one in (*fewer, phases)]).run()


@pytest.mark.usefixtures("empty_figures")
@pytest.mark.parametrize(
    ("camera", "tried", "advice"),
    [("14", "{from: 2, to: 3, points: 2}", "Fresnel"), ("2.5", "{from: 12, to: 16, points: 2}", "Kirchhoff")],
)
def test_advice_at_an_f_number_beside_those_tried_speaks_of_the_camera_alone(
    camera: str, tried: str, advice: str, tmp_path: Path
) -> None:
    """Of one phase, and not the parabolic one of the paper; its error at the camera is 10⁴ and 0.1 times the limit."""
    only = [f"{name}=null" for name in ("claims", "readings", "fresnel_validity.elements.microlens")]
    own = {"elements.main-lens.f_number": camera, "f_numbers": tried, "lens_phases": "[stigmatic]", "tolerance": "1e-3"}
    study = tradestudy.load(STUDY, [*only, *(f"fresnel_validity.{key}={value}" for key, value in own.items())])
    study.run().write(tmp_path, pdf=False)
    text = html.unescape((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert f"main lens, f/{camera}: {advice} if stigmatic (Fresnel errs by" in text
    assert "suffices at" not in text
    assert "(stigmatic phase)" in text


@pytest.mark.parametrize(("limit", "expected"), [(0.1, 10.0), (100.0 / 27.0, 3.0), (20.0, 0.0), (1e-9, np.inf)])
def test_advice_finds_where_a_power_law_falls_to_the_limit(limit: float, expected: float) -> None:
    """An error of 100/N³ falls to 0.1 at f/10. Every f-number tried keeps to 20, and none to 1e-9."""
    tried = np.array([2.0, 4.0, 8.0, 16.0])
    assert _from_f_number(xr.DataArray(100.0 / tried**3, {"f_number": tried}), limit) == pytest.approx(expected)


def on_axis_intensities(
    *, focal_length: float, object_distance: float, f_number: float, wavelength: float, radii: np.ndarray, phase: str
) -> tuple[np.ndarray, np.ndarray]:
    """Fresnel's and Kirchhoff's in-focus intensity by plain quadrature over the aperture, without the program.

    On the axis of symmetry Fresnel is one Hankel integral; Kirchhoff is summed over radius and angle with exact paths.
    """
    k, a = 2 * math.pi / wavelength, object_distance
    b = a * focal_length / (a - focal_length)
    aperture = focal_length / f_number / 2
    t, w = np.polynomial.legendre.leggauss(100)
    rho, weight = aperture * (t + 1) / 2, w * aperture / 2
    fresnel = (2 * np.pi * (weight * rho) @ j0(k * rho[:, None] * radii / b)) ** 2 / (
        wavelength * a * wavelength * b
    ) ** 2
    angle = 2 * np.pi * np.arange(128) / 128
    r_in = np.sqrt(a**2 + rho**2)
    lens = -(rho**2) / (2 * focal_length)
    if phase == "stigmatic":
        lens = -(r_in - a) - (np.sqrt(b**2 + rho**2) - b)
    kirchhoff = []
    for radius in radii:
        out = np.sqrt(b**2 + rho[:, None] ** 2 + radius**2 - 2 * rho[:, None] * radius * np.cos(angle))
        path = ((r_in - a) + lens)[:, None] + (out - b)
        field = np.exp(1j * k * path) * (a / r_in**2)[:, None] * b / out**2 / wavelength**2
        kirchhoff.append(abs(np.sum(weight * rho * field.sum(axis=1)) * 2 * np.pi / angle.size) ** 2)
    return fresnel, np.array(kirchhoff)


@pytest.mark.parametrize("lens", [MAIN | {"f_number": 5.8}, MICRO | {"f_number": 3.8}], ids=["main", "micro"])
@pytest.mark.parametrize("phase", ["parabolic", "stigmatic"])
def test_all_measures_agree_with_plain_quadrature(lens: dict[str, float], phase: str) -> None:
    windows, wavelength = (2.0, 4.0), 450e-9
    found = fresnel_psf_difference(
        **lens, field_angle=0.0, wavelength=wavelength, lens_phases=(phase,), windows=windows, tolerance=1e-7
    )[phase]
    b = lens["object_distance"] * lens["focal_length"] / (lens["object_distance"] - lens["focal_length"])
    airy = 1.2196698912665045 * wavelength * b * lens["f_number"] / lens["focal_length"]
    edges = np.linspace(0, windows[-1], 241)  # midpoint rule: its kinks cost 3e-5 here
    middle = (edges[1:] + edges[:-1]) / 2
    fresnel, kirchhoff = on_axis_intensities(
        **lens, wavelength=wavelength, radii=airy * np.concatenate([[0.0], middle]), phase=phase
    )
    assert found.peak[0] == pytest.approx(abs(fresnel[0] / kirchhoff[0] - 1), rel=1e-4)
    for index, window in enumerate(windows):
        inside = middle < window
        change, exact = np.abs(fresnel - kirchhoff)[1:][inside], kirchhoff[1:][inside]
        l1 = np.sum(change * middle[inside]) / np.sum(exact * middle[inside])
        assert found.l1[index] == pytest.approx(l1, rel=1e-3)
        assert abs(found.l1[index] - l1) <= found.l1_error[index] + 2e-4 * l1
        largest = max(change.max(), abs(fresnel[0] - kirchhoff[0])) / kirchhoff.max()
        assert found.largest[index] == pytest.approx(largest, rel=1e-3)


def test_published_recomputations_of_figure_6() -> None:
    """At 450 nm: L1 over 10 Airy radii 10.0 and 2.6 %; peak 8.6 %, 889 % at f/3.8, and 2.0 %; stigmatic 0.6, 1.5 %."""

    def at(lens: dict[str, float], f_number: float, wavelength: float = 450e-9) -> dict[str, tuple[float, list[float]]]:
        found = fresnel_psf_difference(
            **lens,
            f_number=f_number,
            field_angle=0.0,
            wavelength=wavelength,
            lens_phases=("parabolic", "stigmatic", "perfect"),
            windows=(5.0, 10.0, 20.0),
            tolerance=1e-6,
        )
        return {phase: (float(one.peak[0]), list(one.l1)) for phase, one in found.items()}

    main, fast, micro = at(MAIN, 5.8), at(MAIN, 3.8), at(MICRO, 3.8)
    assert main["parabolic"][0] == pytest.approx(0.086, abs=0.0005)
    assert main["parabolic"][1][1] == pytest.approx(0.1005, abs=0.0007)
    assert fast["parabolic"][0] == pytest.approx(8.89, abs=0.005)
    assert main["stigmatic"][0] == pytest.approx(0.006, abs=0.0005)
    assert fast["stigmatic"][0] == pytest.approx(0.015, abs=0.0005)
    assert micro["parabolic"][0] == pytest.approx(0.020, abs=0.0005)
    assert micro["parabolic"][1] == pytest.approx([0.022, 0.027, 0.032], abs=0.0006)
    assert at(MAIN, 5.8, 550e-9)["parabolic"][1][1] == pytest.approx(0.070, abs=0.0005)
    for one in (main, fast, micro):  # on the axis a stigmatic lens is a perfect one
        assert one["perfect"] == (
            pytest.approx(one["stigmatic"][0], rel=1e-6),
            pytest.approx(one["stigmatic"][1], rel=1e-6),
        )


def test_peak_of_a_weakly_aberrated_lens_follows_the_strehl_ratio() -> None:
    """W r⁴ with W = (1/a³ + 1/b³)/8 at the rim has the variance 4/45 W² about its mean."""
    wavelength, f_number = 550e-9, 9.0
    found = {
        phase: one.peak[0]
        for phase, one in fresnel_psf_difference(
            **MAIN,
            f_number=f_number,
            field_angle=0.0,
            wavelength=wavelength,
            lens_phases=("parabolic", "stigmatic"),
            windows=(1.0,),
            tolerance=1e-8,
        ).items()
    }
    b = 0.150 * 12.5e-3 / (0.150 - 12.5e-3)
    rim = (12.5e-3 / f_number / 2) ** 4 / 8 * (1 / 0.150**3 + 1 / b**3)
    strehl = 1 - (2 * math.pi / wavelength) ** 2 * 4 / 45 * rim**2
    # Both lenses lose the same to cosines; what is left is the Strehl ratio.
    assert (1 + found["stigmatic"]) / (1 + found["parabolic"]) == pytest.approx(strehl, abs=(1 - strehl) * 0.05)


def test_off_axis_rings_agree_with_those_of_more_angles(monkeypatch: pytest.MonkeyPatch) -> None:
    from tradestudy.optics import psf_difference

    def measured() -> psf_difference.PsfDifference:
        return fresnel_psf_difference(
            **MAIN,
            f_number=5.6,
            field_angle=0.0133,
            wavelength=550e-9,
            lens_phases=("parabolic",),
            windows=(3.0,),
            tolerance=1e-7,
        )["parabolic"]

    found = measured()
    monkeypatch.setattr(psf_difference, "_ANGLE_MARGIN", 2.1)
    monkeypatch.setattr(psf_difference, "_INTERVALS", 24)
    finer = measured()
    assert found.l1[0] == pytest.approx(finer.l1[0], rel=2e-4)
    assert abs(found.l1[0] - finer.l1[0]) <= found.l1_error[0]
    assert found.largest[0] == pytest.approx(finer.largest[0], rel=1e-3)


def test_a_tilt_of_the_whole_scene_off_axis_moves_the_perfect_image_only_a_little() -> None:
    """A perfect lens images the point off axis too: Fresnel errs about as on axis, with a fixed element far more."""
    on, off = (
        fresnel_psf_difference(
            **MAIN,
            f_number=3.8,
            field_angle=angle,
            wavelength=550e-9,
            lens_phases=("stigmatic", "perfect"),
            windows=(3.0,),
            tolerance=1e-5,
        )
        for angle in (0.0, math.atan(2 / 150))
    )
    assert off["perfect"].l1[0] == pytest.approx(on["perfect"].l1[0], rel=0.1)
    assert off["stigmatic"].l1[0] > 20 * on["stigmatic"].l1[0]


def test_least_f_number_of_a_known_law() -> None:
    calls: list[float] = []

    def error(f_number: float) -> float:
        calls.append(f_number)
        return 3.0 * f_number**-4 + 1e-3 * f_number**0.5

    found = limit_f_number(error, np.geomspace(2, 16, 9).tolist(), 0.01)
    assert error(found) == pytest.approx(0.01, rel=1e-3)
    assert len(calls) < 20
    assert limit_f_number(lambda f: 1 / f, [2.0, 4.0, 8.0], 0.6) == 0.0
    assert limit_f_number(lambda f: 1 / f, [2.0, 4.0, 8.0], 0.1) == math.inf


def test_claims_are_answered_under_every_reading(result: Result) -> None:
    claims = result.data["claims"].to_dataset()
    value, verdict = claims["value"].sel(reading="as declared"), claims["verdict"]
    assert float(value.sel(claim="F1")) == pytest.approx(5.8, rel=0.01)
    assert float(value.sel(claim="F2")) == pytest.approx(0.1007, abs=0.0005)
    assert float(value.sel(claim="F3")) == pytest.approx(0.0269, abs=0.0003)
    assert str(verdict.sel(claim="F6").item()) == "met"
    for claim in ("F1", "F2", "F3"):
        assert str(verdict.sel(claim=claim).item()) == "cannot be decided from its source"
    for claim, printed in (("F4", 7.3), ("F5", 11.5)):
        assert str(verdict.sel(claim=claim).item()) == "not met"
        tried = claims["value"].sel(claim=claim).values
        assert np.nanmin(np.abs(tried / printed - 1)) > 0.05
    assert float(claims["value"].sel(claim="F4", reading="quarter-wave")) == pytest.approx(
        4.84 * (550 / 450) ** 0.25, abs=0.005
    )
    assert float(claims["value"].sel(claim="F1", reading="stigmatic")) == 0.0


def test_criteria_have_the_published_values(result: Result) -> None:
    """A quarter wave at 550 nm: 4.84 and 2.17; the bigger zero 3.8–5.2 and 1.7–2.4 over 400–700 nm."""
    data = result.data["fresnel_validity"].to_dataset()
    quarter = data["path_error_f_number"].sel(wavelength=550e-9, path_error=0.25)
    assert quarter.values == pytest.approx([4.84, 2.17], abs=0.005)
    for element, low, high in (("main-lens", 3.8, 5.2), ("microlens", 1.7, 2.4)):
        sweep = data["paper_eq27_sweep"].sel(element=element, zero="second")
        assert low < float(sweep.min()) < float(sweep.max()) < high
        assert float(sweep.max() / sweep.min()) > 1.19
        first = data["paper_eq27_sweep"].sel(element=element, zero="first").values
        assert np.isinf(first[:, 0]).all()
        assert np.all(np.diff(first, axis=-1) < 0)


def test_fresnel_errs_less_as_the_aperture_shrinks(result: Result) -> None:
    """Behind the main lens; in the end only the cosines are left, whose effect falls with the second power."""
    data = result.data["fresnel_validity"].to_dataset()
    l1 = data["psf_error"].sel(element="main-lens", metric="l1", window=10, wavelength=550e-9)
    parabolic, perfect = (l1.sel(lens_phase=phase).values for phase in ("parabolic", "perfect"))
    assert np.all(np.diff(parabolic) < 0)
    ratio = float(data["f_number"][-1] / data["f_number"][-2])
    assert perfect[-2] / perfect[-1] == pytest.approx(ratio**2, rel=0.05)
    assert np.all(parabolic >= perfect * (1 - 1e-3))
    errors, numerical = data["psf_error"], data["psf_error_numerical"]
    assert float((numerical / errors).max()) < 0.02


def test_seconds_stay_out_of_the_results(result: Result) -> None:
    assert result.run_record["seconds"]["Fresnel against Kirchhoff, on axis"] > 0
    assert "seconds" not in str(result.data["fresnel_validity"].attrs)
    assert "cameras" in result.data.children  # empty, but there for every reader
    assert "depth" not in result.data.children
    assert "decision" not in result.data.children


def test_figures_and_report_show_it(result: Result, tmp_path: Path) -> None:
    assert {"fresnel_error", "fresnel_criteria", "paper_eq27"} <= set(result.figure_names)
    page = (result.write(tmp_path, pdf=False) / "report.html").read_text(encoding="utf-8")
    assert "fresnel-answer" in page
    assert "printed in the paper: 7.3" in page


@pytest.mark.parametrize(
    ("override", "complaint"),
    [
        ("fresnel_validity.windows=[10, 5]", "must increase"),
        ("fresnel_validity.elements.main-lens.object_distance=10 mm", "must exceed the focal length"),
        ("fresnel_validity.lens_phases=[parabolic, parabolic]", "lens_phases: repeats"),
        ("claims.F1.element=mainlens", "no element 'mainlens'"),
        ("claims.F4.path_error=0.1 waves", "by the criterion path-error"),
        ("fresnel_validity=null", "has no element"),
        ("fresnel_validity.f_numbers.to=1", "must lie beyond from"),
        ("fresnel_validity.f_numbers=[4, 2.8]", "must increase"),
    ],
)
def test_mistakes_are_reported(override: str, complaint: str) -> None:
    with pytest.raises(StudyError, match=complaint):
        tradestudy.load(STUDY, [override])


def test_f_numbers_are_a_list_or_a_range_wherever_they_are_asked_for() -> None:
    for text, values in (("[2.8, 4, 5.6]", (2.8, 4, 5.6)), ("{from: 2, to: 8, points: 3}", (2, 4, 8))):
        part = tradestudy.load(STUDY, [f"fresnel_validity.f_numbers={text}"]).file.fresnel_validity
        assert part is not None
        assert listed(part.f_numbers) == pytest.approx(values)
        spread = tradestudy.load(STUDY.parent / "light_spot.yaml", [f"point_spread.f_numbers={text}"]).file.point_spread
        assert spread is not None
        assert varied_values(spread)["f_number"] == pytest.approx(values)


def test_windows_out_of_order_are_refused() -> None:
    with pytest.raises(OutOfRangeError, match="windows"):
        fresnel_psf_difference(
            **MAIN, f_number=8.0, field_angle=0.0, wavelength=550e-9, lens_phases=("perfect",), windows=(2.0, 1.0),
            tolerance=1e-5,
        )  # fmt: skip


def test_the_conclusion_is_where_the_worst_wavelength_meets_the_limit(result: Result) -> None:
    error = result.data["fresnel_validity"]["psf_error"].sel(metric="l1", window=10.0)
    limits = result.conclusions()["fresnel_validity"]
    assert {one["lens_phase"] for one in limits} == {"parabolic", "perfect"}
    for one in limits:
        element = {"Main lens": "main", "Microlens": "micro"}[one["element"]]
        (name,) = [str(key) for key in error["element"].values if str(key).startswith(element)]
        worst = error.sel(element=name, lens_phase=one["lens_phase"]).max("wavelength")
        above = worst["f_number"].values > one["f_number"]
        assert np.all(worst.values[above] < one["limit"])
        assert np.all(worst.values[~above] >= one["limit"])
    for one in limits:  # the first line says the limit of each element, rounded up
        told = f"from f/{np.ceil(10.0 * one['f_number']) / 10.0:g} on ({one['element'].lower()})"
        every = "at every f-number tried with a perfect phase"
        assert (told if one["lens_phase"] == "parabolic" else every) in result.lines()[0]
