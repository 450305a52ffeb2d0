"""What a study declares of calibrations, against distributions of scipy and what its files hold."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy import stats

from tests.calibration.calibration_files import write_calibration
from tests.study.conftest import STUDIES
from tradestudy.calibration import posteriors
from tradestudy.calibration.calibration_file import CalibrationCovariance, CalibrationDraws
from tradestudy.calibration.corners.corner_file import StereoCorners
from tradestudy.calibration.corners.real_rig import RigFit, fit_rig
from tradestudy.calibration.sources import group_of_draws
from tradestudy.cameras.calibration import ONE_SIGMA, Calibration
from tradestudy.cameras.stereo.declaration import StereoDeclaration
from tradestudy.errors import StudyError
from tradestudy.loaded_study import Study
from tradestudy.study.loading import load_prepared
from tradestudy.study.prepared import Choices, PreparedStudy
from tradestudy.uncertainty.sources import ErrorClass

Written = Callable[[str], PreparedStudy]
BOARD = (
    "{views: 20, columns: 3, rows: 3, spacing: 20 mm, distances: [0.2 m, 1 m], half_field_angle: 45 deg, "
    "tilt: 10 deg, corner_noise: 0.1 px}"
)


@pytest.fixture
def written(tmp_path: Path) -> Written:
    """A study with a stereo rig and an R5 from files in a folder of their own; more of them is laid over it."""
    (tmp_path / "cameras").mkdir()
    for name in ("stereo-100mm", "raytrix-r5"):
        (tmp_path / f"cameras/{name}.yaml").write_text((STUDIES / f"cameras/{name}.yaml").read_text())

    def write(more: str) -> PreparedStudy:
        file = tmp_path / "study.yaml"
        file.write_text(
            "format: 2\nstudy: small\ntitle: Small\nquestion: What?\n"
            "scene: {distances: [0.3 m, 1 m], wavelength: 550 nm}\n" + more
        )
        return load_prepared(file)

    return write


def rig(calibration: str) -> str:
    return f"cameras:\n  rig:\n    from: cameras/stereo-100mm.yaml\n    calibration:\n{calibration}\n"


def test_lengths_inside_a_camera_may_be_counted_in_its_pixels(written: Written) -> None:
    study = written(
        rig("""
      errors:
        focal_length: {standard_deviation: null, shape: student-t, mean: -0.1 px, scale: 0.5 px, degrees_of_freedom: 5}
        left_principal_point_x: {standard_deviation: 0.4 px}
      stability: {ageing: {right_focal_length: {half_width: 0.2 px}}}""")
    )
    rig_ = study.case.cameras["rig"]
    groups = {group.name: group for group in rig_.calibration.groups}
    p, pitch = np.array([0.03, 0.4, 0.9]), rig_.sensor.pixel_pitch
    expected = {
        "focal_length": stats.t(5, loc=-0.1 * pitch, scale=0.5 * pitch).ppf(p),
        "left_principal_point_x": stats.norm(0.0, 0.4 * pitch).ppf(p),
        "ageing_right_focal_length": stats.uniform(-0.2 * pitch, 0.4 * pitch).ppf(p),
    }
    for name, values in expected.items():
        assert groups[name].marginal(0).quantile(p) == pytest.approx(values, rel=1e-12)


@pytest.mark.parametrize(
    ("error", "what"),
    [
        ("left_focal_length: {mean: 1 um, standard_deviation: 0.5 px}", "mixes pixels with lengths"),
        ("left_focal_length: {standard_deviation: 0 px}", "above 0 px is expected"),
        ("left_focal_length: {standard_deviation: 0.5}", "has no unit; a length is expected"),
        ("baseline: {standard_deviation: 0.5 px}", "a length is expected"),
    ],
)
def test_pixels_that_cannot_be_lengths_are_refused(written: Written, error: str, what: str) -> None:
    with pytest.raises(StudyError, match=what):
        written(rig(f"      errors: {{{error}}}"))


def test_every_shape_is_drawn_from_its_own_quantiles(written: Written, tmp_path: Path) -> None:
    (tmp_path / "k1.csv").write_text("k0,k1\n" + "".join(f"0,{value}\n" for value in range(10)))
    study = written(
        rig("""
      errors:
        yaw: {mean: 1 mrad}
        pitch: {standard_deviation: null, half_width: 1 mrad}
        roll: {standard_deviation: null, shape: triangular, half_width: 1 mrad}
        baseline: {standard_deviation: null, shape: student-t, scale: 1 mm, degrees_of_freedom: 5}
        focal_length: {standard_deviation: null, shape: arcsine, half_width: 10 um}
        right_distortion_k2: {shape: curvilinear-trapezoid, half_width: 0.02, inexactness: 0.005}
        left_distortion_k1: {shape: empirical, file: k1.csv, column: k1}""")
    )
    groups = {group.name: group for group in study.case.cameras["rig"].calibration.groups}
    p = np.array([0.03, 0.4, 0.9])
    expected: dict[str, ArrayLike] = {
        "yaw": stats.norm(1e-3, np.radians(0.2)).ppf(p),
        "pitch": stats.uniform(-1e-3, 2e-3).ppf(p),
        "roll": stats.triang(0.5, -1e-3, 2e-3).ppf(p),
        "baseline": stats.t(5, scale=1e-3).ppf(p),
        "focal_length": stats.arcsine(-10e-6, 20e-6).ppf(p),
        "left_distortion_k1": [0.0, 3.0, 8.0],
    }
    for name, values in expected.items():
        assert groups[name].marginal(0).quantile(p) == pytest.approx(np.asarray(values), rel=1e-12)
    # JCGM 101, 6.4.3: u² = (b − a)²/12 + d²/9.
    assert groups["right_distortion_k2"].marginal(0).standard_deviation == pytest.approx(
        np.sqrt(0.04**2 / 12 + 0.005**2 / 9)
    )
    assert set(groups) == {*expected, "right_distortion_k2"}
    assert {group.error_class for group in groups.values()} == {ErrorClass.RIG}


@pytest.mark.parametrize(
    ("error", "table", "said"),
    [
        (
            "baseline",
            "error_mm\n1\n2\n",
            "names another unit than that of its draws.*mm.*allowed: m.*convert the draws",
        ),
        ("baseline", "error [µm]\n1\n2\n", "another unit.*µm.*allowed: m"),
        ("left_focal_length", "f_px\n1\n2\n", "another unit.*px.*allowed: m"),
        ("yaw", "yaw (deg)\n1\n2\n", "another unit.*deg.*allowed: rad"),
        ("yaw", "yaw_m\n1\n2\n", "another unit.*allowed: rad"),
        ("left_distortion_k1", "k1_percent\n1\n2\n", "another unit.*percent.*allowed: no unit"),
        ("baseline", "b\n0,001\n0,002\n", "more cells than columns.*2 cells.*write decimal points"),
        ("baseline", "b,c,b\n1,2,3\n1,2,3\n", "several columns with this name"),
    ],
)
def test_draws_that_would_be_misread_are_refused(
    written: Written, tmp_path: Path, error: str, table: str, said: str
) -> None:
    (tmp_path / "draws.csv").write_text(table)
    column = table.splitlines()[0].split(",")[0]
    declared = f"{{standard_deviation: null, shape: empirical, file: draws.csv, column: '{column}'}}"
    with pytest.raises(StudyError, match=said):
        written(rig(f"      errors: {{{error}: {declared}}}"))


@pytest.mark.parametrize("column", ["b", "baseline_m", "baseline [m]", "draw_1", "principal_point", "\ufeffb"])
def test_draws_in_si_units_are_read(written: Written, tmp_path: Path, column: str) -> None:
    (tmp_path / "draws.csv").write_text(f"{column}\n1e-3\n2e-3\n3e-3\n")
    declared = f"shape: empirical, file: draws.csv, column: '{column.lstrip(chr(0xFEFF))}'"
    study = written(rig(f"      errors: {{baseline: {{standard_deviation: null, {declared}}}}}"))
    groups = {group.name: group for group in study.case.cameras["rig"].calibration.groups}
    assert groups["baseline"].marginal(0).standard_deviation == pytest.approx(1e-3 * np.sqrt(2 / 3))


def test_correlations_tie_what_they_connect_and_nothing_else(written: Written) -> None:
    study = written(
        rig("""
      errors:
        left_distortion_k1: {standard_deviation: 0.01}
        right_distortion_k1: {half_width: 0.02}
      correlations:
        left_distortion_k1: {right_distortion_k1: 0.8}
        yaw: {roll: -0.5}
        focal_length: {roll: 0.3}""")
    )
    groups = {group.parameters: group for group in study.case.cameras["rig"].calibration.groups}
    names = ("left_distortion_k1", "right_distortion_k1")
    assert set(groups) == {("baseline",), ("yaw", "roll", "focal_length"), ("pitch",), names}
    drawn = groups[names].draw(np.random.default_rng(0).standard_normal((2, 40_000)))
    # A Gaussian copula of normal scores correlated by ρ has the rank correlation (6/π) asin(ρ/2).
    assert stats.spearmanr(drawn[0], drawn[1]).statistic == pytest.approx(6 / np.pi * np.arcsin(0.4), abs=0.01)
    assert np.abs(drawn[1]).max() <= 0.02
    np.testing.assert_allclose(
        groups["yaw", "roll", "focal_length"].correlation, [[1, -0.5, 0], [-0.5, 1, 0.3], [0, 0.3, 1]]
    )


def test_correlations_to_the_edge_of_what_is_possible(written: Written) -> None:
    """Three equal correlations are possible down to −1/2."""
    text = rig("      correlations: {{yaw: {{pitch: {rho}, roll: {rho}}}, pitch: {{roll: {rho}}}}}")
    assert written(text.format(rho=-0.5)).case.cameras["rig"].calibration.inferred
    assert written(text.format(rho=1)).case.cameras["rig"].calibration.inferred
    with pytest.raises(StudyError, match=r"the matrix of yaw, pitch, roll has the eigenvalue -0.002"):
        written(text.format(rho=-0.501))


def test_drift_is_drawn_for_every_session(written: Written) -> None:
    study = written(
        rig("""
      stability:
        temperature: {standard_deviation: 3 K}
        pressure: {half_width: 2 kPa}
        color: {standard_deviation: 6.3 um}
        ageing: {yaw: {standard_deviation: 1 mrad}}
        housing_expansion: 23 ppm/K
        focal_length_expansion: 10 ppm/K
        glass_index: 1.52""")
    )
    calibration = study.case.cameras["rig"].calibration
    since = {g.name: g for g in calibration.groups if g.error_class is ErrorClass.SESSION}
    assert list(since) == ["temperature_change", "pressure_change", "color_shift", "ageing_yaw"]
    deviations = [group.marginal(0).standard_deviation or 0.0 for group in since.values()]
    np.testing.assert_allclose(deviations, [3.0, 2000 / np.sqrt(3), 6.3e-6, 1e-3])
    assert calibration.environment is not None
    assert (calibration.environment.temperature, calibration.environment.pressure) == (293.15, 101325.0)
    assert calibration.environment.housing_expansion == pytest.approx(23e-6)


WARM_R5 = """\
cameras:
  r5:
    from: cameras/raytrix-r5.yaml
    calibration:
      stability:
        temperature: {standard_deviation: 3 K}
        housing_expansion: 23 ppm/K
        focal_length_expansion: 10 ppm/K
        glass_index: 1.52
"""


@pytest.mark.parametrize(
    ("declared", "drift"),  # of the section-6 R5 at 1 m and 3 K, from tests/cameras/test_warming.py
    [
        (("array_expansion: 23 ppm/K", "sensor_expansion: 0 ppm/K"), -6.0e-4),
        (("array_expansion: 7 ppm/K", "sensor_expansion: 0 ppm/K"), 2.40e-3),
        (("array_expansion: 7 ppm/K",), 2.88e-3),
        (("array_expansion: 7 ppm/K", "microlens_centers: found-again"), 3.71e-3),
    ],
)
def test_a_study_says_how_array_and_sensor_expand(written: Written, declared: tuple[str, ...], drift: float) -> None:
    study = written(WARM_R5 + "".join(f"        {line}\n" for line in declared))
    camera = study.case.cameras["r5"]
    warm = camera.read(np.array([1.0]), 0.0, {"temperature_change": np.array([[3.0]])}, camera.calibration.environment)
    assert 1.0 / warm.inverse_depth[0, 0] - 1.0 == pytest.approx(drift, rel=0.01)
    assumed = dict(study.file.cameras["r5"].assumed())
    stability = ("calibration", "stability")
    assert assumed.get((*stability, "sensor_expansion")) == (None if "sensor" in declared[-1] else "2.6 ppm/K")
    assert assumed.get((*stability, "microlens_centers")) == (None if "centers" in declared[-1] else "kept")


def test_a_warm_array_needs_its_material_and_a_rig_s_bracket_is_its_housing(written: Written) -> None:
    with pytest.raises(StudyError, match=r"needs stability\.array_expansion too"):
        written(WARM_R5)
    warm = """
      stability:
        temperature: {standard_deviation: 3 K}
        housing_expansion: 23 ppm/K
        focal_length_expansion: 10 ppm/K
        glass_index: 1.52"""
    for more, baseline in (("", 23e-6), ("\n        baseline_expansion: 1 ppm/K", 1e-6)):
        environment = written(rig(warm + more)).case.cameras["rig"].calibration.environment
        assert environment is not None
        assert environment.baseline_expansion == pytest.approx(baseline)
        assert environment.scale_expansion == pytest.approx(2.6e-6)


def test_without_a_change_of_the_surroundings_there_is_no_environment(written: Written) -> None:
    study = written(rig("      stability: {ageing: {roll: {half_width: 1 mrad}}}"))
    assert study.case.cameras["rig"].calibration.environment is None
    assert study.case.cameras["rig"].calibration.source == "errors"


@pytest.mark.parametrize("suffix", ["csv", "nc"])
def test_a_saved_posterior_joins_the_errors_that_it_does_not_determine(
    written: Written, tmp_path: Path, suffix: str
) -> None:
    names = ("yaw", "right_principal_point_x")
    covariance = np.array([[1e-6, 0.996 * 1e-3 * 3e-5], [0.996 * 1e-3 * 3e-5, 9e-10]])
    draws = np.random.default_rng(1).multivariate_normal([2e-3, 5e-5], covariance, 5000)
    mean = np.array([2e-3, 5e-5])
    write_calibration(tmp_path / f"a.{suffix}", CalibrationCovariance(names=names, mean=mean, covariance=covariance))
    write_calibration(tmp_path / f"b.{suffix}", CalibrationDraws(names=names, draws=draws))
    for file in (f"a.{suffix}", f"b.{suffix}"):
        study = written(rig(f"      errors: {{yaw: null}}\n      posterior: {{file: {file}}}"))
        calibration = study.case.cameras["rig"].calibration
        groups = {group.name: group for group in calibration.groups}
        assert set(groups) == {"baseline", "pitch", "roll", "focal_length", "calibration"}
        assert groups["calibration"].parameters == names
        np.testing.assert_allclose(groups["calibration"].nominal, mean, rtol=0.05)  # errors keep their mean
        found = groups["calibration"].covariance
        assert found is not None
        np.testing.assert_allclose(found, covariance, rtol=0.1)
        assert calibration.source == "posterior"
        assert list(study.definition.data_files.values()) == [tmp_path / file]
        assert study.definition.posterior_keys == {}


def test_files_are_found_relative_to_the_camera_file_that_names_them(written: Written, tmp_path: Path) -> None:
    (tmp_path / "cameras/rig.csv").write_text("parameter,mean,yaw\nyaw,0,1e-6\n")
    camera = (tmp_path / "cameras/stereo-100mm.yaml").read_text()
    own = camera[: camera.index("calibration:")] + "calibration: {posterior: {file: rig.csv}}\n"
    (tmp_path / "cameras/own.yaml").write_text(own)
    study = written("cameras: {rig: {from: cameras/own.yaml}}")
    assert dict(study.definition.data_files) == {"cameras.rig.calibration.posterior.file": tmp_path / "cameras/rig.csv"}
    assert study.case.cameras["rig"].calibration.groups[0].parameters == ("yaw",)


def target(calibration: str = "", more: str = "") -> str:
    return rig(f"      target: {BOARD}\n{calibration}") + more


def test_a_shared_calibration_is_inferred_once(written: Written) -> None:
    study = written(
        target(
            "      stability: {ageing: {roll: {standard_deviation: 1 mrad}}}",
            "readings:\n"
            "  noisier: {says: noisier, set: {rig.depth.disparity_error: 0.2 px}}\n"
            "  steadier: {says: steadier, set: {rig.calibration.stability.ageing.roll.standard_deviation: 0.1 mrad}}\n"
            "  wider: {says: wider, set: {rig.baseline: 120 mm}}\n"
            "  rougher: {says: rougher, set: {rig.calibration.errors.yaw.standard_deviation: 1 deg}}\n"
            "  again: {says: again, set: {propagation.seed: 1}}\n",
        )
    )
    key = study.definition.posterior_keys["rig"]
    same = {name: one.definition.posterior_keys["rig"] == key for name, one in study.readings.items()}
    assert same == {"noisier": True, "steadier": True, "wider": False, "rougher": False, "again": False}
    assert not study.case.cameras["rig"].calibration.inferred

    draws = np.random.default_rng(0).standard_normal((500, 2))
    found = Calibration(groups=(group_of_draws("calibration", ("yaw", "pitch"), draws),), source="target")
    known = replace(study, choices=Choices(posteriors={key: found}))
    calibration = known.case.cameras["rig"].calibration
    assert [group.name for group in calibration.groups] == [
        "baseline", "roll", "focal_length", "calibration", "ageing_roll",
    ]  # fmt: skip
    assert (calibration.inferred, calibration.source) == (True, "target")
    steadier = known.readings["steadier"].case.cameras["rig"].calibration
    assert steadier.groups[-2] is calibration.groups[-2]
    assert steadier.groups[-1].marginal(0).standard_deviation == pytest.approx(1e-4)
    assert not known.readings["wider"].case.cameras["rig"].calibration.inferred


def test_a_camera_that_nothing_changes_is_calibrated_once(written: Written) -> None:
    study = written(target(more="  other: {like: rig, baseline: 50 mm}\n"))
    changed = study.with_values({"rig.baseline": "70 mm"})
    assert changed.case.cameras["other"] is study.case.cameras["other"]
    assert changed.case.cameras["rig"] is not study.case.cameras["rig"]
    known = replace(
        changed, choices=Choices(posteriors={changed.definition.posterior_keys["rig"]: Calibration(source="target")})
    )
    assert known.case.cameras["other"] is study.case.cameras["other"]
    assert known.case.cameras["rig"].calibration.inferred


def test_the_angle_of_a_target_is_a_slope_to_inference(written: Written) -> None:
    declared = written(target()).file.cameras["rig"]
    assert isinstance(declared, StereoDeclaration)
    assert declared.calibration.target is not None
    assert declared.calibration.target.half_field == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("coverage", "stated"),
    [
        ("[95 %]", (ONE_SIGMA, 0.95)),
        ("[99 %, 68.27 %, 50 %]", (ONE_SIGMA, 0.5, 0.99)),
        ("[99.9 %]", (ONE_SIGMA, 0.999)),
        ("[]", (ONE_SIGMA,)),
    ],
)
def test_the_interval_of_one_standard_deviation_is_always_stated_first(
    written: Written, coverage: str, stated: tuple[float, ...]
) -> None:
    study = written(
        rig("      errors: {}")
        + f"propagation: {{seed: 18446744073709551615, coverage: {coverage}}}\naccuracy: {{tolerance: 2 %}}"
    )
    propagation = study.case.cameras["rig"].propagation
    assert propagation.coverages == stated
    assert (propagation.seed, propagation.tolerance, propagation.model) == (2**64 - 1, 0.02, "linear")
    exact = replace(study, choices=Choices(models={"rig": {"calibration": "exact"}})).case.cameras["rig"]
    assert exact.propagation.model == "exact"
    perfect = replace(study, choices=Choices(models={"rig": {"calibration": "off"}})).case.cameras["rig"]
    assert perfect.propagation.model == "off"


def test_several_values_are_varied_together(written: Written) -> None:
    study = written(
        "cameras: {r5: {from: cameras/raytrix-r5.yaml}}\n"
        "solve:\n  array:\n    says: how\n    vary:\n"
        "      - r5.calibration.errors.mla_distance.standard_deviation\n"
        "      - r5.calibration.errors.focal_length.standard_deviation\n"
        "    low: 0.1 um\n    high: 10 um\n    camera: r5\n    relative: 1 %\n    at: 0.3 m\n"
    )
    changed = study.with_values(dict.fromkeys(study.file.solve["array"].paths, "3 um"))
    tied = changed.case.cameras["r5"].calibration.groups[0]
    np.testing.assert_allclose([tied.marginal(i).standard_deviation or 0.0 for i in range(2)], 3e-6)


def test_corners_that_cannot_be_used_are_mistakes_of_the_study(written: Written, tmp_path: Path) -> None:
    corners = rig("      errors: null\n      corners: {file: corners.csv}")
    (tmp_path / "corners.csv").write_text("view,corner\n1,2\n")
    with pytest.raises(StudyError, match=r"study.yaml:11:23: cameras.rig.calibration.corners.file: .*board_x_mm"):
        written(corners)
    (tmp_path / "corners.csv").write_text((STUDIES / "data/stereo_chessboard_corners.csv").read_text())
    small = corners.replace("    calibration:", "    sensor: {pixels: [320, 240]}\n    calibration:")
    with pytest.raises(StudyError, match=r"corners.file: declared sensor 320 × 240 px, but corners lie"):
        written(small)


def test_lens_models_of_imported_corners_are_checked_before_their_fit(written: Written, tmp_path: Path) -> None:
    (tmp_path / "corners.csv").write_text((STUDIES / "data/stereo_chessboard_corners.csv").read_text())
    camera = "{from: corners.csv, sensor: {pixels: [640, 360]}"
    with pytest.raises(
        StudyError, match=r"study.yaml:6:\d+: cameras.a.calibration.corners.lens_model.model: .*nearest"
    ):
        written(f"cameras: {{a: {camera}, calibration: {{corners: {{lens_model: {{model: kanala-brandt}}}}}}}}}}")
    other = "{like: a, calibration: {corners: {lens_model: {model: kannala-brandt}}}}"
    with pytest.raises(StudyError, match=r"cameras.b.calibration.corners.lens_model: .* a fit of rational with k1 k2"):
        written(f"cameras: {{a: {camera}}}, b: {other}}}")
    with pytest.raises(StudyError, match=r"cameras.rig.distortion.model: this key is missing"):
        written("cameras: {rig: {from: cameras/stereo-100mm.yaml, distortion: {k1: 0.1}}}")


def test_corner_files_of_readings_are_checked(written: Written, tmp_path: Path) -> None:
    (tmp_path / "good.csv").write_text((STUDIES / "data/stereo_chessboard_corners.csv").read_text())
    (tmp_path / "bad.csv").write_text("view,corner\n1,2\n")
    readings = "readings: {other: {says: other, set: {rig.calibration.corners.file: bad.csv}}}"
    with pytest.raises(StudyError, match=r"readings.other: cameras.rig.calibration.corners.file: bad.csv lacks"):
        written(f"cameras: {{rig: {{from: good.csv, sensor: {{pixels: [640, 360]}}}}}}\n{readings}")


def test_check_refuses_corners_that_contradict_the_declared_geometry_as_a_run_does(
    written: Written, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fitted: list[int] = []

    def counted(corners: StereoCorners) -> RigFit:
        fitted.append(len(corners.views))
        return fit_rig(corners)

    monkeypatch.setattr(posteriors, "fit_rig", counted)
    text = (STUDIES / "data/stereo_chessboard_corners.csv").read_text()
    (tmp_path / "corners.csv").write_text(text)
    webcams = (
        "cameras: {{rig: {{kind: stereo, title: Webcams, lenses: {{focal_length: 461 px}}, baseline: {baseline} mm, "
        "sensor: {{pixels: [640, 360], pixel_pitch: 3 um}}, depth: {{disparity_error: 0.1 px}}, "
        "calibration: {{corners: {{file: corners.csv}}}}}}}}"
    )
    assert "no mistakes" in Study(written(webcams.format(baseline=94.1)).definition).check()
    assert fitted == [8]  # of 29: quick if nothing is wrong
    definition = written(webcams.format(baseline=80)).definition
    with pytest.raises(StudyError, match=r"corners: declared baseline 80 mm, corners say 94.1 ± 0.2 mm") as caught:
        Study(definition).check()
    assert fitted == [8, 29]  # all views decide; the same corners are fitted once, whatever is declared
    with pytest.raises(StudyError) as of_run:
        Study(definition).run()
    assert str(caught.value) == str(of_run.value)
    assert fitted == [8, 29]
    (tmp_path / "corners.csv").write_text(text.replace("left", "l").replace("right", "left").replace("l_", "right_"))
    with pytest.raises(StudyError, match=r"cameras.rig.calibration.corners: the left and right columns are exchanged"):
        Study(written(webcams.format(baseline=94.1)).definition).check()
