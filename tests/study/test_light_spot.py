"""The light spot and the spread of points: closed forms, the scene's closure, and what reaches report and record."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.optimize import brentq
from scipy.special import j0, j1

import tradestudy
from tradestudy.api import Result
from tradestudy.errors import OutOfRangeError, StudyError
from tradestudy.models import spot_images
from tradestudy.models.point_spreads import LensAndPoint, spread_measures
from tradestudy.report.document import Callout, Paragraph, Table, spans
from tradestudy.report.sections.light_spot import describe_light_spot_answer

STUDY = Path(__file__).parents[2] / "studies" / "light_spot.yaml"
# One microlens of the scene, and a spot of which it sees the whole.
SMALL = [
    "light_spot.microlenses.lenses_across=1",
    "light_spot.detector.pixels=23",
    "light_spot.spot.diameter=2 mm",
    "light_spot.tolerance=5 %",
    "light_spot.methods=[geometric, kirchhoff-fresnel, kirchhoff]",
    "light_spot.benchmarks=false",
    "point_spread.f_numbers=[3.8]",
    "point_spread.wavelengths=[550 nm]",
    "point_spread.field_angles=[0 deg]",
    "point_spread.defocus=[0 waves, 0.5 waves]",
    "point_spread.window=6",
    "point_spread.rms_radius=5",
    "claims.S4.method=kirchhoff-fresnel",
    "claims.S3.under=[]",
    "claims.S2.under=[]",
]


@pytest.fixture(scope="module")
def result() -> Result:
    spot_images._spot_picture.cache_clear()  # its seconds are looked at
    return tradestudy.load(STUDY, SMALL).run()


def image(result: Result, propagator: str) -> np.ndarray:
    return np.asarray(result.data["images"]["image"].sel(propagator=propagator).values)


def test_a_looser_tolerance_loosens_the_pictures_that_are_compared() -> None:
    found = {text: tradestudy.load(STUDY, tolerance=text) for text in ("50 %", "10 %", "1 %", "0.1 %")}
    tolerances = {text: study.file.light_spot.tolerance for text, study in found.items() if study.file.light_spot}
    assert tolerances == {"50 %": 0.2, "10 %": 0.1, "1 %": 0.01, "0.1 %": 0.01}


def test_the_declared_scene_is_consistent() -> None:
    """Microlenses in focus at 150 mm and f-numbers matched: z 15.271 mm, b_L 0.587 mm, |v| 2.78."""
    spot = tradestudy.load(STUDY).file.light_spot
    assert spot is not None
    lens, array = spot.main_lens, spot.microlenses
    main_image = 1 / (1 / lens.focal_length - 1 / spot.spot.distance)
    depth = spot.mla_distance - main_image
    assert 1 / depth + 1 / array.gap == pytest.approx(1 / array.focal_length, rel=1e-3)
    assert array.gap / array.pitch == pytest.approx(spot.mla_distance / (lens.focal_length / lens.f_number), rel=1e-3)
    assert depth / array.gap == pytest.approx(2.78, abs=0.01)
    assert array.pitch == pytest.approx(23 * spot.detector.pixel_pitch)


@pytest.mark.parametrize("propagator", ["geometric", "kirchhoff-fresnel", "kirchhoff"])
def test_the_image_has_the_size_that_two_thin_lenses_give(result: Result, propagator: str) -> None:
    """Diameter 2 mm × (b_M/a) × (b_L/a_L); the area above half of the plateau is that of this disc."""
    pixels = image(result, propagator)
    main_image = 1 / (1 / 12.5e-3 - 1 / 0.150)
    diameter = 2e-3 * main_image / 0.150 * 0.587e-3 / (15.271e-3 - main_image)
    plateau = float(np.median(pixels[9:14, 9:14]))
    share = np.clip(pixels / plateau, 0, 1)  # a pixel cut by the rim counts by the part of it that is lit
    assert share.sum() * 5.5e-6**2 == pytest.approx(math.pi / 4 * diameter**2, rel=0.03)


@pytest.mark.parametrize(
    ("propagator", "within"), [("geometric", 0.002), ("kirchhoff-fresnel", 0.05), ("kirchhoff", 0.05)]
)
def test_the_power_is_that_of_the_cone_through_the_microlens(result: Result, propagator: str, within: float) -> None:
    """Each point lights a disc A |a_L|/b_M wide on the array; the microlens, inside it, takes its area's share."""
    main_image = 1 / (1 / 12.5e-3 - 1 / 0.150)
    lit = 12.5e-3 / 3.8 * (15.271e-3 - main_image) / main_image
    assert image(result, propagator).sum() == pytest.approx((0.432e-3 / 3.8 / lit) ** 2, rel=within)


def test_images_keep_the_symmetry_of_the_scene(result: Result) -> None:
    rays_error = float(result.data["images"]["numerical_error"].sel(propagator="geometric"))
    for propagator, within in (("geometric", rays_error), ("kirchhoff", 1e-6)):
        pixels = image(result, propagator)
        for turned in (pixels.T, pixels[::-1], pixels[:, ::-1]):
            assert np.linalg.norm(turned - pixels) < within * np.linalg.norm(pixels)


def test_a_spot_off_the_axis_is_imaged_on_its_own_side() -> None:
    """Twice inverted is upright; rows count along y, columns along x."""
    part = tradestudy.load(STUDY, [*SMALL, "light_spot.spot.x=0.5 mm", "light_spot.spot.y=-0.25 mm"]).file.light_spot
    assert part is not None
    pixels = spot_images.spot_image(part, "geometric").pixels
    place = 5.5 * (np.arange(23) - 11)
    scale = 12.5 / (150 - 12.5) * 0.587 / (15.271 - 1 / (1 / 12.5 - 1 / 150))
    assert pixels.sum(axis=0) @ place / pixels.sum() == pytest.approx(500 * scale, abs=1.0)
    assert pixels.sum(axis=1) @ place / pixels.sum() == pytest.approx(-250 * scale, abs=1.0)


def test_a_spot_is_refused_only_where_rays_leave_the_picture_dark() -> None:
    part = tradestudy.load(STUDY, [*SMALL, "light_spot.spot.x=7 mm"]).file.light_spot
    assert part is not None
    assert not spot_images.spot_image(part, "geometric").pixels.any()
    with pytest.raises(StudyError, match="puts the light"):
        tradestudy.load(STUDY, [*SMALL, "light_spot.spot.x=7.2 mm"])


def test_measures_of_the_images_agree_with_their_definitions(result: Result) -> None:
    data = result.data["images"].to_dataset()
    exact, rays = image(result, "kirchhoff"), image(result, "geometric")
    difference = data["difference"].sel(propagator="geometric", against="kirchhoff")
    assert float(difference) == pytest.approx(np.abs(rays - exact).sum() / exact.sum(), rel=1e-12)
    dark = float(data["outside_geometric"].sel(propagator="kirchhoff"))
    assert dark == pytest.approx(exact[rays == 0].sum() / exact.sum(), rel=1e-12)
    assert 0 < dark < 0.1
    assert int(data["lit_pixels"].sel(propagator="geometric")) == int((rays > 0.01 * rays.max()).sum())
    assert float(data["numerical_error"].max()) < 0.1
    assert float(data["difference"].sel(propagator="kirchhoff-fresnel", against="kirchhoff")) < 0.05


def test_errors_of_the_measures_bound_what_errors_of_an_image_can_change(result: Result) -> None:
    """Errors of the stated norm, with any pattern, change each measure by at most its error."""
    data = result.data["images"].to_dataset().sel(propagator="kirchhoff", against="kirchhoff-fresnel")
    exact, dark = image(result, "kirchhoff"), image(result, "geometric") == 0
    size = 1e-3 * float(data["numerical_error"]) * np.linalg.norm(exact)
    patterns = [np.ones_like(exact), dark - dark.mean(), *np.random.default_rng(1).normal(size=(9, *exact.shape))]
    changed = [exact + size * pattern / np.linalg.norm(pattern) for pattern in patterns]
    measures = {
        "power": np.sum,
        "outside_geometric": lambda pixels: pixels[dark].sum() / pixels.sum(),
        "difference": lambda pixels: np.abs(pixels - image(result, "kirchhoff-fresnel")).sum(),
    }
    for name, measure in measures.items():
        largest = max(abs(measure(pixels) - measure(exact)) for pixels in changed)
        assert largest <= 1e-3 * float(data[f"{name}_error"]) * (1.0 + 1e-9), name
    assert abs(changed[0].sum() - exact.sum()) == pytest.approx(1e-3 * float(data["power_error"]), rel=1e-6)


def test_claims_of_figure_7_are_checked_on_the_same_images(result: Result) -> None:
    claims, data = result.data["claims"].to_dataset(), result.data["images"].to_dataset()
    declared = claims["value"].sel(reading="as declared")
    lit = data["lit_pixels"]
    assert float(declared.sel(claim="S1")) == float(lit.sel(propagator="kirchhoff") / lit.sel(propagator="geometric"))
    for claim, propagator in (("S2", "geometric"), ("S3", "kirchhoff-fresnel")):
        against = data["difference"].sel(propagator=propagator, against="kirchhoff")
        assert float(declared.sel(claim=claim)) == float(against)


def test_seconds_are_in_the_record_and_never_in_the_results(result: Result) -> None:
    for propagator in ("geometric", "kirchhoff-fresnel", "kirchhoff"):
        assert result.run_record["seconds"][f"image: {propagator}"] > 0
    hours = result.data["images"]["published_seconds"]
    assert float(hours.sel(propagator="kirchhoff")) == 50 * 3600
    assert float(hours.sel(propagator="kirchhoff-fresnel")) == 26 * 3600
    assert np.isnan(float(hours.sel(propagator="geometric")))
    part = tradestudy.load(STUDY, SMALL).file.light_spot
    assert part is not None
    spot_images._spot_picture.cache_clear()
    pixels = spot_images.spot_image(part, "kirchhoff").pixels
    assert np.array_equal(pixels, image(result, "kirchhoff"))


def answer_of(result: Result, data: xr.Dataset) -> tuple[str, Table]:
    """What the first page says about the picture of the study, and its table of all methods."""
    blocks = list(describe_light_spot_answer(xr.DataTree.from_dict({"/images": data}), result.run_record))
    (box,) = (block for block in blocks if isinstance(block, Callout))
    (told,) = box.blocks
    assert isinstance(told, Paragraph)
    (table,) = (block for block in blocks if isinstance(block, Table))
    return "".join(span.text for span in spans(told.text)).replace("\u00a0", " "), table


def test_the_answer_describes_the_picture_of_the_study(result: Result) -> None:
    data = result.data["images"].to_dataset()
    assert re.search(r"computed in [0-9.]+ s\.$", answer_of(result, data)[0])
    for method, said in (
        ("kirchhoff", "Its method is the reference of the table."),
        ("geometric", "the same picture as in the table."),
    ):
        found, _ = answer_of(result, data.assign(chosen_image=data["image"].sel(propagator=method, drop=True)))
        assert found.endswith(said)
        assert "—" not in found
    # Without methods to compare there is one picture, the study's own, which takes its time.
    single = data.sel(propagator=["kirchhoff"], against=["kirchhoff"])
    seconds = {"image: chosen": 3.0}
    alone = replace(result, run_record={**result.run_record, "seconds": seconds})
    (row,) = answer_of(alone, single)[1].rows
    assert row[1:3] == ("3\u00a0s", "about 50 hours")


def test_report_shows_seconds_hours_and_why_they_do_not_compare(result: Result, tmp_path: Path) -> None:
    assert {"light_spot", "point_spread"} <= set(result.figure_names)
    page = (result.write(tmp_path, pdf=False) / "report.html").read_text(encoding="utf-8")
    for words in (
        "just a few seconds",
        "26 hours",
        "about 50 hours",
        "discretisation and the machine behind the published times",
    ):
        assert words in page


def case(**changes: float | str) -> LensAndPoint:
    usual = {
        "focal_length": 12.5e-3,
        "object_distance": 0.150,
        "f_number": 8.0,
        "wavelength": 550e-9,
        "lens_phase": "perfect",
        "field_angle": 0.0,
        "defocus_waves": 0.0,
    }
    return LensAndPoint(**(usual | changes))  # type: ignore[arg-type]  # fields of two kinds in one mapping


def test_the_conclusion_is_the_summed_difference_from_the_reference(result: Result) -> None:
    assert result.conclusions()["headline"] == result.lines()[0]
    pictures = result.conclusions()["light_spot"]
    assert [one["method"] for one in pictures] == list(result.data["images"]["propagator"].values)
    whole = image(result, "kirchhoff")
    for one in pictures:
        assert one["reference"] == "kirchhoff"
        if one["method"] == "kirchhoff":
            assert one["difference"] is None
        else:
            change = np.abs(image(result, one["method"]) - whole).sum() / whole.sum()
            assert one["difference"] == pytest.approx(change, rel=1e-9)
    (line,) = [line for line in result.lines() if line.startswith("Pictures differ from Kirchhoff")]
    assert line.count("%") == len(pictures) - 1
    assert len(re.findall(r", [\d.]+ m?s\b", line)) == len(pictures)


@pytest.fixture(scope="module")
def focused() -> dict[str, tuple[float, float]]:
    return dict(
        spread_measures(case(), method="fresnel", window=9.0, rms_radius=5.0, pixel_pitch=5.5e-6, tolerance=1e-7)
    )


def test_in_focus_the_measures_are_those_of_the_airy_pattern(focused: dict[str, tuple[float, float]]) -> None:
    working = 8.0 * 0.150 / (0.150 - 12.5e-3)
    unit = 550e-9 * working / math.pi  # v = π r/(λ N_w)
    half = brentq(lambda v: (2 * j1(v) / v) ** 2 - 0.5, 1.0, 2.0)
    value, error = focused["full_width"]
    assert value == pytest.approx(2 * half * unit, abs=3 * error + 1e-5 * value)
    for name, share in (("half_energy_radius", 0.5), ("energy_radius_80", 0.8)):
        radius = brentq(lambda v, s=share: 1 - j0(v) ** 2 - j1(v) ** 2 - s, 0.5, 6.0)
        value, error = focused[name]
        assert value == pytest.approx(radius * unit, abs=3 * error + 1e-4 * value)
    assert focused["strehl_ratio"][0] == pytest.approx(1, abs=1e-5)
    s = 550e-9 * working / (4 * 5.5e-6)
    transfer, error = focused["transfer_half_nyquist"]
    assert transfer == pytest.approx(2 / math.pi * (math.acos(s) - s * math.sqrt(1 - s**2)), abs=error)
    v = np.linspace(1e-6, 5 * 1.2196698912665045 * math.pi, 200_001)
    weight = (2 * j1(v) / v) ** 2 * v
    assert focused["rms_width"][0] == pytest.approx(unit * math.sqrt(np.sum(weight * v**2) / np.sum(weight)), rel=1e-3)


def test_half_a_wave_of_defocus_follows_the_sinc() -> None:
    """On axis (sin πW/πW)², and paraxial rays fill R b |1/a' − 1/a|; Kirchhoff at f/8 differs by cosines."""
    moved = case(defocus_waves=0.5)
    assert moved.geometric_radius == pytest.approx(
        moved.radius * moved.image_distance * abs(1 / moved.source.distance - 1 / 0.150), rel=1e-9
    )
    found = spread_measures(moved, method="kirchhoff", window=6.0, rms_radius=5.0, pixel_pitch=5.5e-6, tolerance=1e-6)
    assert found["strehl_ratio"][0] == pytest.approx((2 / math.pi) ** 2, rel=0.01)
    assert 0 < found["outside_geometric"][0] < 1


def test_values_beyond_the_window_are_nan() -> None:
    found = spread_measures(
        case(lens_phase="parabolic", f_number=2.8), method="kirchhoff", window=3.0, rms_radius=2.0, pixel_pitch=5.5e-6,
        tolerance=1e-4,
    )  # fmt: skip
    assert math.isnan(found["energy_radius_80"][0])
    assert math.isnan(found["neighbour_share"][0])
    assert found["strehl_ratio"][0] < 0.2


def test_defocus_beyond_infinity_is_refused() -> None:
    with pytest.raises(OutOfRangeError, match="beyond infinity"):
        case(f_number=16.0, defocus_waves=-3.0).source  # noqa: B018


def test_the_spread_group_varies_one_thing_at_a_time(result: Result) -> None:
    data = result.data["point_spread"].to_dataset()
    radius = data["half_energy_radius"].sel(propagator="kirchhoff")
    for element in ("main-lens", "microlens"):
        one = radius.sel(element=element).isel(step=0)
        assert np.ptp(one.values) == 0.0  # the first step of everything varied is the lens as it stands
    assert np.isnan(radius.sel(varied="f_number").isel(step=1)).all()
    assert float(
        data["strehl_ratio"].sel(element="main-lens", propagator="fresnel", varied="defocus")[0]
    ) == pytest.approx(1, abs=1e-4)


@pytest.mark.parametrize(
    ("override", "complaint"),
    [
        ("light_spot.microlenses.f_number=2", "wider than their pitch"),
        ("light_spot.methods=[kirchhoff, kirchhoff]", "methods: repeats"),
        ("light_spot.methods=[kirchhoff, geometric]", "published_times.1.method: 'kirchhoff-fresnel' is not one of"),
        ("light_spot.published_times.1.method=geometric", "published_times.1.method: 'geometric' already has a pub"),
        ("light_spot.tolerance=50 %", "out of range"),
        # 30 mm · 15.271/150; 3 lenses of 126.5 um; twice the 586 um of light and lenses, times 150/15.271
        ("light_spot.spot.x=30 mm", "spot.x: puts the light 3.05.mm off .* microlenses reach only to 190.*11.[56].mm"),
        ("light_spot.spot.y=-30 mm", "spot.y: puts the light 3.05.mm off the axis"),
        (
            "light_spot.microlenses.focal_length=[0.4 mm]",
            "this list has only one value; the value without brackets or at least 2 are expected",
        ),
        ("light_spot.detector.pixel_pitch=1e6 m", "1e6 m.* 10 nm to 5 mm"),
        (
            "light_spot.spectrum={wavelengths: [500 nm, 600 nm], weights: [1e-300, 1]}",
            "weights.0: '1e-300' is out of range; a number from 1e-30 to 1e30 in SI units is expected",
        ),
    ],
)
def test_mistakes_are_reported(override: str, complaint: str) -> None:
    with pytest.raises(StudyError, match=complaint):
        tradestudy.load(STUDY, [override])
