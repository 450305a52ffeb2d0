"""A declared matcher from the study file to depth, requirements and the words of the report; and what is refused."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr

import tradestudy
from tradestudy.answers.requirements import check_requirement
from tradestudy.api import Result
from tradestudy.cameras.depth_camera import disparity_error_at
from tradestudy.depth.evaluation import distribution, evaluate_depth, model_error
from tradestudy.errors import StudyError
from tradestudy.execution.steps import fingerprint
from tradestudy.imaging.picture import at_bound
from tradestudy.models.depth_problem import depth_problems
from tradestudy.models.plan import plan_of
from tradestudy.report.contents import compose_report
from tradestudy.report.document import Block, Bullets, Heading, Paragraph, Table, Text, all_blocks, spans
from tradestudy.results.views.depth import lower_bound_words
from tradestudy.results.views.requirement_conclusions import requirement_conclusions, requirement_sentence
from tradestudy.study.loading import load_prepared
from tradestudy.study.prepared import Choices, PreparedStudy

STUDIES = Path(__file__).parents[2] / "studies"
ROBOT = STUDIES / "robot.yaml"
FEW = "scene.distances.points=20"
OF_SCENE = (
    "scene.picture.matcher={factor: {value: 1.5, basis: assumed, note: of a test}, floor: 0.05 px, "
    "pixel_locking: 0.1 px, false_matches: 2 %}"
)
HEAD = "stereo-75mm"
CAVEAT = "Lower bound, as no matcher is declared"
PLACES = np.array([0.5, 1.0, 3.0])
REQUIRED = (
    "requirements={near-and-mid: null, far: {says: 0.78 % up to 3 m, camera: stereo-75mm, "
    "depth_uncertainty: {below_relative: 0.78 %, over: [0.4 m, 3 m]}}}"
)


def study(*changes: str) -> PreparedStudy:
    return load_prepared(ROBOT, (FEW, *changes))


def plain(text: Text) -> str:
    return "".join(span.text for span in spans(text)).replace("\u00a0", " ")


def texts(blocks: tuple[Block, ...]) -> list[str]:
    found = []
    for block in all_blocks(blocks):
        if isinstance(block, Paragraph):
            found.append(plain(block.text))
        elif isinstance(block, Bullets):
            found += [plain(item) for item in block.items]
        elif isinstance(block, Table):
            found += [plain(block.caption), *(plain(note) for note in block.notes)]
    return found


def first_page(blocks: tuple[Block, ...]) -> list[str]:
    anchors = [k for k, block in enumerate(blocks) if isinstance(block, Heading)]
    begin = next(k for k in anchors if blocks[k].anchor == "answer")
    return texts(blocks[begin : next(k for k in anchors if k > begin)])


# ---- depth ----------------------------------------------------------------------------------------------------------


def test_depth_uses_the_error_of_the_matcher() -> None:
    real, bound = (study(*change).case.cameras[HEAD] for change in ((OF_SCENE,), ()))
    by_matcher, at_best = disparity_error_at(real, PLACES), disparity_error_at(bound, PLACES)
    np.testing.assert_allclose(by_matcher**2, (1.5 * at_best) ** 2 + 0.05**2 + 0.1**2 / 2.0, rtol=1e-12)
    # Noise of parallel cameras far below their disparity is u = Z² σ/(c B).
    noise = [evaluate_depth(one, PLACES).uncertainty[0] for one in (real, bound)]
    np.testing.assert_allclose(noise[0] / noise[1], by_matcher / at_best, rtol=2e-3)
    both, calibration = (evaluate_depth(real, PLACES).uncertainty[index] for index in (2, 1))
    np.testing.assert_allclose(both, np.hypot(noise[0], calibration), rtol=5e-3)


@pytest.mark.parametrize("model", ["linear", "exact"])
def test_false_matches_add_to_failures_beyond_infinity(model: str) -> None:
    """Of a pair of 0.05 mm base at 4 m, Φ(−d/σ) ends beyond infinity; of what is left a share is falsely matched."""
    far = np.array([2.0, 4.0])
    changes = ("stereo-75mm.baseline=0.05 mm", f"effects.calibration={model}", "accuracy.tolerance=5 %")
    own = "stereo-75mm.calibration.errors.yaw.standard_deviation=1e-9 deg"
    definition = study(OF_SCENE, own, *changes)
    camera = plan_of(definition).study.case.cameras[HEAD]
    assert camera.propagation.model == model
    beyond = ndtr(-camera.disparity(far) / camera.noise(far))
    assert beyond[1] > 0.05
    found = evaluate_depth(camera, far)
    for index in (0, 2):
        truth = 1.0 - (1.0 - beyond) * (1.0 - 0.02)
        np.testing.assert_allclose(found.failed_fraction[index], truth, rtol=5e-3)
    assert np.all(found.failed_fraction[1] == 0.0)  # a calibration matches nothing
    np.testing.assert_array_equal(
        distribution(camera, far, "both").half_width,
        distribution(_without_false(definition, model), far, "both").half_width,
    )


def _without_false(study: PreparedStudy, model: str) -> object:
    found = study.with_values({"scene.picture.matcher.false_matches": "0 %"})
    return plan_of(found).study.case.cameras[HEAD]


def test_the_linear_model_is_compared_with_draws_that_have_the_same_false_matches() -> None:
    cameras = [study(*change).case.cameras[HEAD] for change in ((OF_SCENE,), ())]
    error = [model_error(one, PLACES).failed_fraction for one in cameras]
    np.testing.assert_allclose(error, 0.0, atol=1e-12)


def test_the_best_matcher_equals_no_matcher() -> None:
    best = study("scene.picture.matcher={factor: 1, floor: 0 px, pixel_locking: 0 px, false_matches: 0 %}")
    assert best.case.cameras == study().case.cameras


def test_a_camera_overrides_the_matcher_key_by_key() -> None:
    found = study(OF_SCENE, "raytrix-r5.depth.matcher.factor=3").case.cameras
    matchers = {name: camera.disparity_error_px.matcher for name, camera in found.items()}
    assert matchers["raytrix-r5"].factor == 3.0
    assert matchers["raytrix-r5"].floor == matchers[HEAD].floor == 0.05
    assert matchers[HEAD].factor == 1.5
    alone = study("raytrix-r5.depth.matcher.floor=0.1 px").case.cameras
    assert alone[HEAD] == study().case.cameras[HEAD]
    assert alone["raytrix-r5"].disparity_error_px.matcher.floor == 0.1


def test_checkpoints_distinguish_matchers() -> None:
    cameras = [
        study(f"stereo-75mm.depth.matcher={{{one}}}").case.cameras[HEAD]
        for one in ("factor: 1", "factor: 1.1", "floor: 0.1 px", "pixel_locking: 0.1 px", "false_matches: 1 %")
    ]
    assert len({fingerprint(one) for one in cameras}) == len(cameras)


def test_a_floor_makes_the_physics_of_the_picture_matter_less() -> None:
    """How much leaving diffraction out changes the depth noise, by the plan and by computing it again."""
    off = {"main_lens_diffraction": "off"}
    moved = {}
    for name, changes in {"bound": (), "real": (OF_SCENE,)}.items():
        definition = study("accuracy.depth_noise=5 %", *changes)
        problem = next(one for one in depth_problems(definition, {}) if one.name == HEAD)
        (variant,) = problem._variants
        reported = variant.moved_noise({**problem.complete, **off})
        models = {HEAD: {"main_lens_diffraction": "off"}}, {HEAD: {"main_lens_diffraction": "fresnel"}}
        without, complete = (
            evaluate_depth(replace(definition, choices=Choices(models=one)).case.cameras[HEAD], variant.places).judged[
                0
            ]
            for one in models
        )
        np.testing.assert_allclose(reported, without / complete - 1.0, atol=1e-9)
        moved[name] = float(np.max(np.abs(reported)))
    assert moved["real"] < 0.3 * moved["bound"]


def test_the_plan_separates_false_matches_from_other_failures() -> None:
    """A limit of 5 % with 2 % of false matches is one of 3/98 without; an end that it sets moves as far."""
    short = ("stereo-75mm.baseline=0.5 mm", "usable_range.relative_uncertainty=null")
    false = study(*short, "usable_range.failed_fraction=5 %", "stereo-75mm.depth.matcher.false_matches=2 %")
    true = study(*short, f"usable_range.failed_fraction={0.03 / 0.98!r}")
    found = [next(one for one in depth_problems(each, {}) if one.name == HEAD) for each in (false, true)]
    for problem in found:
        assert problem._variants[0].ends.size
        while problem.try_out({**problem.complete, "calibration": "linear"}):
            pass
    for model in ("off", "linear"):
        changes = [problem.changes({**problem.complete, "calibration": model}) for problem in found]
        assert changes[0]["usable_range"].relative > 0.0
        for quantity, change in changes[0].items():
            assert change.relative == pytest.approx(changes[1][quantity].relative, rel=1e-3)


# ---- the file -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "place", "words"),
    [
        (
            "stereo-50mm.depth={disparity_error: 0.1 px, matcher: {factor: 2}}",
            "stereo-50mm.depth.matcher",
            "is declared",
        ),
        ("scene.picture.matcher.factor=0.9", "scene.picture.matcher.factor", "of 1 or more is expected"),
        ("scene.picture.matcher.floor=-1 px", "scene.picture.matcher.floor", "of 0 px or more is expected"),
        ("scene.picture.matcher.pixel_locking=1 px", "scene.picture.matcher.pixel_locking", "from 0 px to 0.5 px"),
        ("scene.picture.matcher.false_matches=100 %", "scene.picture.matcher.false_matches", "less than 1"),
        ("scene.picture.matcher.flor=1 px", "scene.picture.matcher.flor", "floor"),
        ("scene.picture.matcher={}", "scene.picture.matcher", "at least one of factor, floor, pixel_locking and"),
    ],
)
def test_mistakes_are_reported_at_their_place(change: str, place: str, words: str) -> None:
    with pytest.raises(StudyError) as caught:
        study(change)
    reported = [one for one in caught.value.problems if one.path.endswith(place)]
    assert any(words in one.what for one in reported), caught.value


def edited(folder: Path, *edits: tuple[str, str]) -> Path:
    """The robot's study with other lines."""
    text = ROBOT.read_text(encoding="utf-8").replace("from: cameras/", f"from: {(STUDIES / 'cameras').as_posix()}/")
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    file = folder / "robot.yaml"
    file.write_text(text, encoding="utf-8")
    return file


def line_of(file: Path, text: str) -> int:
    return next(k for k, line in enumerate(file.read_text(encoding="utf-8").splitlines(), start=1) if text in line)


def test_an_inherited_matcher_is_taken_back_with_its_derived_error(tmp_path: Path) -> None:
    matcher = ("      discrimination_step", "      matcher: {factor: 2}\n      discrimination_step")
    own, null = "    baseline: {value: 75 mm", "    depth: {disparity_error: 0.1 px%s}\n    baseline: {value: 75 mm"
    file = edited(tmp_path, matcher, (own, null % ""))
    with pytest.raises(StudyError, match=r"remove matcher .*null") as caught:
        load_prepared(file, ())
    assert caught.value.problems[0].line == line_of(file, "matcher: {factor: 2}")
    found = load_prepared(edited(tmp_path, matcher, (own, null % ", matcher: null")), ()).case.cameras
    assert found[HEAD].disparity_error_px == 0.1
    assert found["stereo-50mm"].disparity_error_px.matcher.factor == 2.0


def test_a_matcher_of_the_scene_that_no_camera_has_warns_at_its_line(tmp_path: Path) -> None:
    declared = ("value: derived, basis: derived", "value: 0.1 px, basis: assumed")
    file = edited(tmp_path, declared, ("    read_noise:", "    matcher: {factor: 2}\n    read_noise:"))
    line = line_of(file, "matcher: {factor: 2}")
    (reported,) = tradestudy.load(file).warnings
    assert reported.startswith(f"{file}:{line}:")
    assert "scene.picture.matcher: " in reported
    assert "derived disparity errors" in reported
    assert not tradestudy.load(ROBOT, [OF_SCENE]).warnings


def test_an_implausible_value_causes_a_warning() -> None:
    (reported,) = tradestudy.load(ROBOT, ["scene.picture.matcher.floor=5 px"]).warnings
    assert "5 px is unusual" in reported.replace("\u00a0", " ")


def test_both_places_can_be_swept() -> None:
    sweep = {"scene.picture.matcher.factor": ["1", "2"], "raytrix-r5.depth.matcher.floor": ["0 px", "0.1 px"]}
    only_depth = [f"{name}=null" for name in ("decision", "requirements", "trade_off", "stereo-50mm")]
    changed = tradestudy.load(ROBOT, [FEW, "scene.distances.to=1.5 m", *only_depth]).with_values({"sweep": sweep})
    depth = changed.run().data["depth"]["disparity_error_px"]
    factors, floors = "factor", "floor"
    head, r5 = (depth.sel(camera=name) for name in (HEAD, "raytrix-r5"))
    np.testing.assert_allclose(head.sel({factors: 2.0}), 2.0 * head.sel({factors: 1.0}), rtol=1e-12)
    squares = r5.sel({floors: 0.1}) ** 2 - r5.sel({floors: 0.0}) ** 2
    np.testing.assert_allclose(squares.values[np.isfinite(squares.values)], 0.01, rtol=1e-9)
    with pytest.raises(StudyError, match=r"scene\.picture\.texture\.contrast cannot be swept"):
        changed.with_values({"sweep": {"scene.picture.texture.contrast": ["1 %", "2 %"]}})


# ---- results and words ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def real() -> Result:
    return tradestudy.load(ROBOT, [FEW, OF_SCENE, REQUIRED]).run()


@pytest.fixture(scope="module")
def ideal() -> Result:
    return tradestudy.load(ROBOT, [FEW, REQUIRED]).run()


def test_both_disparity_errors_stand_side_by_side(real: Result, ideal: Result) -> None:
    causes = real.data["disparity_causes"].to_dataset()
    for name in ("disparity_error_px", "disparity_error_px_error"):
        np.testing.assert_array_equal(causes[name], ideal.data["disparity_causes"][name])
    truth = (1.5 * causes["disparity_error_px"]) ** 2 + 0.05**2 + 0.1**2 / 2.0
    np.testing.assert_allclose(causes["matched_error_px"] ** 2, truth, rtol=1e-12)
    assert bool((causes["matched_error_px_error"] < 1.5 * causes["disparity_error_px_error"]).all())
    assert causes["false_matches"].values.tolist() == [0.02] * 3
    blocks = tuple(compose_report(real.data, {}, {}).blocks)
    (table,) = (one for one in all_blocks(blocks) if isinstance(one, Table) and one.name == "disparity-causes-table")
    assert [plain(column.title) for column in table.columns[3:5]] == ["By matcher", "Bound"]
    one = causes.sel(camera=HEAD).isel(distance=1)
    row = [plain(cell) for cell in table.rows[6]]
    assert [float(cell) for cell in row[3:5]] == pytest.approx(
        [float(one["matched_error_px"]), float(one["disparity_error_px"])], rel=5e-3
    )
    reported = " ".join(texts(blocks))
    assert (
        "The declared matcher of 50 mm stereo head, 75 mm stereo head and Raytrix R5 adds noise 1.5 times the bound, "
        "a floor of 0.05 px, pixel locking of 0.1 px (0.0707 px rms) and 2 % false matches." in reported
    )
    assert "does not average out within one distance" in reported
    assert re.search(r"Fraction of measurements\b[^.]*\bfalse matches\.", reported)
    assert CAVEAT not in reported


def test_a_requirement_reports_whether_the_bound_alone_would_meet_it(real: Result) -> None:
    definition = study(REQUIRED)
    (required,) = definition.file.requirements.values()
    case = plan_of(study(OF_SCENE, REQUIRED)).study.case
    by_matcher = check_requirement(required, case, HEAD)
    row = real.data["requirements"].to_dataset().isel(requirement=0)
    assert float(row["value"]) == pytest.approx(by_matcher.value, rel=1e-9)
    best = evaluate_depth(at_bound(case.cameras[HEAD]), np.array([3.0])).uncertainty[2, 0] / 3.0
    assert float(row["bound_alone_value"]) == pytest.approx(best, rel=1e-6)
    assert float(row["bound_alone_place"]) == pytest.approx(3.0)
    assert (int(row["met"]), int(row["bound_alone_met"])) == (0, 1)
    (one,) = requirement_conclusions(real.data)
    sentence = requirement_sentence(one).replace("\u00a0", " ")
    assert sentence.startswith("Not met: 0.78 % up to 3 m, not by 75 mm stereo head (worst ")
    assert sentence.endswith(f"; met if matching reached its bound (worst {100 * best:.3g} % at 3 m)")
    reported = json.loads(json.dumps(real.conclusions()))["requirements"][0]["bound_alone"]
    assert reported["met"] is True


def test_without_a_matcher_the_report_says_that_the_error_is_the_bound(ideal: Result) -> None:
    assert not any(str(name).startswith("bound_alone") for name in ideal.data["requirements"].data_vars)
    assert "matched_error_px" not in ideal.data["disparity_causes"].data_vars
    (one,) = requirement_conclusions(ideal.data)
    assert one.met
    assert requirement_sentence(one).startswith(
        "Met if matching is as exact as the pictures allow: 0.78 % up to 3 m, by 75 mm stereo"
    )
    assert ideal.lines()[1] == requirement_sentence(one).replace("\u00a0", " ")
    reported = ideal.conclusions()
    assert (reported["requirements"][0]["on_lower_bound"], reported["lower_bounds"]) == (True, ["75 mm stereo head"])
    blocks = tuple(compose_report(ideal.data, {}, {}).blocks)
    first = " ".join(first_page(blocks))
    assert "Met if matching is as exact as the pictures allow" in first
    assert CAVEAT not in first  # the verdict says it of the only camera in the answer
    (causes,) = (text for text in texts(blocks) if CAVEAT in text)
    assert causes.startswith(f"{CAVEAT}: the disparity error of 50 mm stereo head, 75 mm stereo head and ")


def test_one_matcher_of_several_cameras_leaves_the_others_at_the_bound() -> None:
    result = tradestudy.load(ROBOT, [FEW, "raytrix-r5.depth.matcher.factor=2", "trade_off=null"]).run()
    causes = result.data["disparity_causes"].to_dataset()
    assert causes["matcher"].values.tolist() == ["", "", "noise 2 times the bound"]
    heads = ["stereo-50mm", HEAD]
    np.testing.assert_array_equal(
        causes["matched_error_px"].sel(camera=heads), causes["disparity_error_px"].sel(camera=heads)
    )
    reported = texts(tuple(compose_report(result.data, {}, {}).blocks))
    head, both = lower_bound_words(("50 mm stereo head", "75 mm stereo head"))
    assert any(text.startswith(f"{head}: {both[0]}") for text in reported)


def test_the_register_has_each_value_with_its_basis(real: Result) -> None:
    rows = real.data["assumptions"].to_dataset()
    one = rows.sel(path="scene.picture.matcher.factor")
    assert [str(one[name].item()) for name in ("value", "basis", "note")] == ["1.5", "assumed", "of a test"]


def test_repeating_a_measurement_does_not_show_pixel_locking(real: Result) -> None:
    sheet = real.data["datasheet"].to_dataset().sel(camera=HEAD)
    camera, places = plan_of(study(OF_SCENE, REQUIRED)).study.case.cameras[HEAD], sheet["sheet_distance"].values
    whole = disparity_error_at(camera, places)
    ratio = np.sqrt(whole**2 - 0.1**2 / 2.0) / whole
    np.testing.assert_allclose(sheet["temporal_noise"] / sheet["plane_fit_rms"], ratio, rtol=1e-3)
