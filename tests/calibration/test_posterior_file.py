"""A posterior saved and loaded: the same bits, the same measured depths, and what is refused."""

from dataclasses import replace

import h5netcdf
import numpy as np
import pytest
import xarray

from tests.calibration.calibration_files import write_calibration
from tests.calibration.cameras import (
    board,
    focused,
    normal,
    shown,
    stereo,
    unfocused,
    webcams,
)
from tests.calibration.radial_rig import SHARED_NAMES
from tests.data.simulate_corners import true_rig
from tradestudy.calibration.calibration_file import CalibrationCovariance, CalibrationDraws, CalibrationFileError
from tradestudy.calibration.corners.rig_measurement import GeometryContradictionError
from tradestudy.calibration.posterior_file import posterior_of_file, write_posterior
from tradestudy.calibration.posteriors import infer
from tradestudy.uncertainty.sources import ErrorClass

DISTANCES = np.array([0.3, 1.0, 5.0])


def errors_of(calibration):
    (group,) = calibration.groups
    scores = np.random.default_rng(0).standard_normal((group.dimensions, 500))
    return dict(zip(group.parameters, group.draw(scores)[..., None], strict=True))


def test_a_rig_of_corners_is_loaded_bit_for_bit(tmp_path, calibrated_webcams):
    """Draws, what they are about, and hence every depth."""
    path, rig = tmp_path / "rig.nc", calibrated_webcams
    write_posterior(path, rig.posterior)
    loaded = posterior_of_file(path, "rig", webcams())
    assert loaded.source == "posterior"
    assert loaded.vocabulary == rig.calibration.vocabulary
    for field in (0.0, 0.5):
        found, expected = (
            calibration.measurement(DISTANCES, field, errors_of(calibration), None)
            for calibration in (loaded, rig.calibration)
        )
        assert np.array_equal(found.inverse_depth, expected.inverse_depth)
        assert np.array_equal(found.no_overlap, expected.no_overlap)
    write_posterior(tmp_path / "again.nc", rig.posterior)
    assert path.read_bytes() == (tmp_path / "again.nc").read_bytes()


def test_a_target_is_loaded_bit_for_bit(tmp_path):
    asked = shown(stereo(), (normal("yaw", 3e-3), normal("right_principal_point_x", 50e-6)), board(max_steps=200))
    inferred = infer(asked)
    write_posterior(tmp_path / "rig.nc", inferred.posterior)
    loaded = posterior_of_file(tmp_path / "rig.nc", "rig", stereo())
    found, expected = (errors_of(calibration) for calibration in (loaded, inferred.calibration))
    assert list(found) == list(expected)
    assert all(np.array_equal(found[name], expected[name]) for name in found)
    assert loaded.measurement is None


NAMES = ("yaw", "baseline")
SPREAD = np.array([3e-4, 1e-4])  # rad, m; the rig's axes are parallel, and its baseline is 100 mm


def group_of(folder, kind, mean, spread=SPREAD):
    """The group and the remark of a file of draws or of a covariance, with these means of yaw and baseline."""
    scores = np.random.default_rng(0).standard_normal((400, 2))
    scores = (scores - scores.mean(axis=0)) / scores.std(axis=0)
    what = {
        "draws": CalibrationDraws(names=NAMES, draws=np.array(mean) + spread * scores),
        "covariance": CalibrationCovariance(names=NAMES, mean=np.array(mean), covariance=np.diag(np.square(spread))),
    }[kind]
    write_calibration(folder / "rig.csv", what)
    calibration = posterior_of_file(folder / "rig.csv", "rig", stereo(baseline=0.1))
    (group,) = calibration.groups
    np.testing.assert_allclose(np.diag(group.covariance), np.square(spread), rtol=1e-9, atol=1e-30)
    assert group.error_class is ErrorClass.RIG
    return group, calibration.remark


@pytest.mark.parametrize("kind", ["draws", "covariance"])
def test_errors_in_a_file_keep_their_mean(tmp_path, kind):
    group, remark = group_of(tmp_path, kind, (8e-4, -2e-4))
    np.testing.assert_allclose(group.nominal, [8e-4, -2e-4], rtol=1e-9)
    assert not remark


@pytest.mark.parametrize("kind", ["draws", "covariance"])
@pytest.mark.parametrize(
    ("deviation", "shift", "says"), [(1e-4, 1e-4, " and baseline by −100 µm"), (0.0, 0.0, ""), (0.08, 0.0, "")]
)
def test_values_of_parameters_are_centred_on_the_declared_ones(tmp_path, kind, deviation, shift, says):
    """Also a constant, and one so uncertain that it could be an error."""
    group, remark = group_of(tmp_path, kind, (-3e-4, 0.1 + shift), np.array([3e-4, deviation]))
    np.testing.assert_allclose(group.nominal, 0.0, atol=1e-15)
    assert remark == (
        "the file contains values of the parameters, not errors; their means count as the declared values, which "
        f"shifts yaw by 0.0003 rad{says}"
    )


@pytest.mark.parametrize("kind", ["draws", "covariance"])
@pytest.mark.parametrize(
    ("mean", "says"),
    [
        (
            (0.01, 0.0),
            r"mean of yaw in rig.csv .*: 0.01 rad, with .* of 0.0003 rad \(allowed: within 3 .* of 0\)",
        ),
        (
            (0.0, 0.12),
            r"mean of baseline .*: 120 mm, with .* of 100 µm \(allowed: within 3 .* of 0, or of the declared 100 mm",
        ),
        ((0.01, 0.1), r"mean of yaw in"),  # yaw is an error, the baseline is not
    ],
)
def test_means_that_contradict_the_design_are_refused(tmp_path, kind, mean, says):
    with pytest.raises(CalibrationFileError, match=says):
        group_of(tmp_path, kind, mean)


def test_a_reference_says_where_errors_are_zero(tmp_path):
    """As in exports of declared errors with a mean that no rule would recognise."""
    draws = [0.01, 0.0] + SPREAD * np.random.default_rng(0).standard_normal((400, 2))
    write_posterior(tmp_path / "rig.nc", CalibrationDraws(names=NAMES, draws=draws, reference=np.zeros(2)))
    (group,) = posterior_of_file(tmp_path / "rig.nc", "rig", stereo()).groups
    np.testing.assert_array_equal(group.draws, draws)


def stated(path, names=NAMES, mean=(0.0, 0.1), spread=SPREAD, more=None, units=None):
    """The calibration of a rig of 100 mm from a NetCDF file of draws with more variables and units of the draws."""
    draws = mean + spread * np.random.default_rng(5).standard_normal((2000, len(names)))
    data = xarray.Dataset({"draws": (("draw", "parameter"), draws)} | (more or {}), coords={"parameter": list(names)})
    data["draws"].attrs |= {} if units is None else {"units": units}
    data.to_netcdf(path, engine="h5netcdf")
    return posterior_of_file(path, "rig", stereo(baseline=0.1))


def test_a_reference_other_than_the_declared_values_is_refused_or_named(tmp_path):
    """A reference of 80 mm and 50 µm of spread for a rig of 100 mm; and one that differs by two deviations."""
    spread = np.array([1.7e-4, 5e-5])
    with pytest.raises(
        CalibrationFileError, match=r"reference of baseline in far.nc .*80 mm, .*49.5 µm.*within 3 .*declared 100 mm"
    ):
        stated(tmp_path / "far.nc", mean=(0.0, 0.08), spread=spread, more={"reference": ("parameter", [0.0, 0.08])})
    near = stated(tmp_path / "near.nc", spread=spread, more={"reference": ("parameter", [0.0, 0.1001])})
    assert near.remark == "the reference in the file counts as the declared values, which shifts baseline by −100 µm"
    assert near.groups[0].nominal[1] == pytest.approx(-1e-4, abs=5e-6)
    same = stated(tmp_path / "same.nc", spread=spread, more={"reference": ("parameter", [0.0, 0.1])})
    assert not same.remark
    error = {"names": ("yaw",), "mean": [0.0], "spread": np.array([1e-4]), "more": {"reference": ("parameter", [2e-4])}}
    assert "which shifts yaw by −0.0002 rad" in stated(tmp_path / "error.nc", **error).remark


def test_weights_of_draws_are_refused_and_other_variables_named(tmp_path):
    half = np.arange(2000) < 1000
    with pytest.raises(CalibrationFileError, match=r"not read: weight .*resample the draws by their weights"):
        stated(tmp_path / "one.nc", more={"weight": ("draw", np.where(half, 1.98, 0.02))})
    others = {"weight": ("draw", np.ones(2000)), "correlation": ((), 0.3), "draw": ("draw", np.arange(2000))}
    assert stated(tmp_path / "two.nc", more=others).remark.endswith("not used from the file: weight and correlation")


@pytest.mark.parametrize("mark", [-9999.0, 1e20, np.float32(1e20), np.array([1e20, -9999.0])])
@pytest.mark.parametrize("key", ["_FillValue", "missing_value"])
def test_draws_marked_as_missing_are_refused(tmp_path, key, mark):
    draws = 3e-4 * np.random.default_rng(5).standard_normal((2000, 1))
    for path, missing in ((tmp_path / "all.nc", 0), (tmp_path / "part.nc", 8)):
        draws[:missing] = np.ravel(mark)[-1]
        with h5netcdf.File(path, "w") as file:
            file.dimensions = {"draw": 2000, "parameter": 1}
            file.create_variable("parameter", ("parameter",), data=np.array(["yaw"], dtype=np.bytes_))
            file.create_variable("draws", ("draw", "parameter"), data=draws).attrs[key] = mark
    assert posterior_of_file(tmp_path / "all.nc", "rig", stereo()).remark == ""
    with pytest.raises(
        CalibrationFileError, match=rf"missing values: 8 cells of draws equal its {key} .*remove the draws"
    ):
        posterior_of_file(path, "rig", stereo())


def test_units_other_than_si_are_refused(tmp_path):
    yaw = {"names": ("yaw",), "mean": [0.0], "spread": np.array([0.01])}
    message = r"{} in .* states another unit for yaw: {} \(allowed: rad\); convert the numbers"
    for more, units, says in (
        ({"units": ("parameter", ["deg"])}, None, ("units", "deg")),
        ({"unit": ("parameter", np.array([b"deg"]))}, None, ("unit", "deg")),
        ({}, "deg", ("draws", "deg")),
        ({}, "mrad", ("draws", "mrad")),
        ({}, "m", ("draws", "m")),
        ({}, "rad, m", ("draws", "rad, m")),
        ({"reference": ("parameter", [0.0], {"units": "deg"})}, "rad", ("reference", "deg")),
    ):
        with pytest.raises(CalibrationFileError, match=message.format(*says)):
            stated(tmp_path / "rig.nc", **yaw, more=more, units=units)
    rig = xarray.load_dataset(tmp_path / "rig.nc", engine="h5netcdf").drop_vars("reference")
    rig["draws"].attrs = {}
    for key in ("unit", "units"):
        for attrs, owner in ((rig["draws"].attrs, "draws"), (rig.attrs, key)):
            attrs[key] = "deg"
            rig.to_netcdf(tmp_path / "attribute.nc", engine="h5netcdf")
            with pytest.raises(CalibrationFileError, match=message.format(owner, "deg")):
                posterior_of_file(tmp_path / "attribute.nc", "rig", stereo())
            attrs[key] = "rad"
    rig["draws"].attrs["long_name"] = rig.attrs["comment"] = "yaw"
    rig.to_netcdf(tmp_path / "attribute.nc", engine="h5netcdf")
    remark = posterior_of_file(tmp_path / "attribute.nc", "rig", stereo()).remark
    assert remark == "not used from the file: comment and draws.long_name"
    for units in ("rad", "radians", "SI", ""):
        assert stated(tmp_path / "rig.nc", **yaw, units=units).remark == ""
    assert stated(tmp_path / "rig.nc", units="rad, m").remark
    data = {"mean": ("parameter", [0.0]), "covariance": (("parameter", "parameter_"), [[1e-8]], {"units": "deg^2"})}
    xarray.Dataset(data, coords={"parameter": ["yaw"]}).to_netcdf(tmp_path / "cov.nc", engine="h5netcdf")
    with pytest.raises(CalibrationFileError, match=r"covariance in .* for yaw: deg\^2 \(allowed: rad\^2\)"):
        posterior_of_file(tmp_path / "cov.nc", "rig", stereo(baseline=0.1))
    best = saved(tmp_path / "best.nc")
    with xarray.open_dataset(best, engine="h5netcdf") as found:
        found.load()
    found["best"].attrs["units"] = "mm"
    found.to_netcdf(tmp_path / "mm.nc", engine="h5netcdf")
    with pytest.raises(CalibrationFileError, match=r"best in mm.nc states another unit"):
        posterior_of_file(tmp_path / "mm.nc", "rig", stereo())


def saved(path, **changes):
    """A posterior of the simulated rig with narrow draws."""
    draws = true_rig() + 1e-9 * np.random.default_rng(0).standard_normal((200, 18))
    values = {"names": SHARED_NAMES, "draws": draws, "best": true_rig(), "pixels": (1024, 1024)}
    write_posterior(path, CalibrationDraws(**(values | changes)))
    return path


@pytest.mark.parametrize("camera", [focused(), unfocused()])
def test_the_posterior_of_a_pair_is_refused_for_a_single_camera(tmp_path, camera):
    with pytest.raises(CalibrationFileError, match=r"rig\.nc .*stereo rig.* r5 "):
        posterior_of_file(saved(tmp_path / "rig.nc"), "r5", camera)


def test_unknown_names_are_reported(tmp_path):
    with pytest.raises(CalibrationFileError, match=r"rig\.nc names parameters that the camera does not have: shift_x"):
        posterior_of_file(saved(tmp_path / "rig.nc", names=(*SHARED_NAMES[:-1], "shift_x")), "rig", stereo())
    draws = CalibrationDraws(names=("yaw", "tilt"), draws=np.random.default_rng(0).standard_normal((200, 2)))
    write_posterior(tmp_path / "other.nc", draws)
    with pytest.raises(CalibrationFileError, match=r"does not have: tilt \(allowed: baseline, "):
        posterior_of_file(tmp_path / "other.nc", "rig", stereo())


def test_a_contradiction_of_posterior_and_declared_rig_gives_both_values(tmp_path):
    path = saved(tmp_path / "rig.nc")
    assert posterior_of_file(path, "rig", stereo()).measurement is not None
    with pytest.raises(
        GeometryContradictionError, match=r"declared baseline 200 mm, the posterior says 100.*another posterior"
    ):
        posterior_of_file(path, "rig", stereo(baseline=0.2))


def test_a_posterior_of_pictures_of_another_size_is_refused(tmp_path):
    path = saved(tmp_path / "rig.nc", pixels=(1024, 768))
    with pytest.raises(CalibrationFileError, match=r"another size: 1024 × 768 \(allowed: 1024 × 1024, the pixels"):
        posterior_of_file(path, "rig", stereo())


def test_pictures_and_exports_of_a_rig_with_a_posterior_are_those_of_its_best_values(tmp_path):
    """Against OpenCV's projection with the best values; without the posterior, both are those of the design."""
    cv2 = pytest.importorskip("cv2")
    rig = stereo()
    rig = replace(rig, calibration=posterior_of_file(saved(tmp_path / "rig.nc"), "rig", rig))
    best = true_rig()
    world = np.array([[0.05, -0.03, 0.9], [-0.1, 0.08, 1.3]])
    left, right = rig.exposures(1.0, {}, None, 0.0)
    from_left = (world - np.array(left.pose.centre)) @ np.array(left.pose.rotation)
    for one, pose, interior in ((left, np.zeros(6), best[:6]), (right, best[12:], best[6:12])):
        fx, fy, cx, cy, k1, k2 = interior
        matrix = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
        image, _ = cv2.projectPoints(from_left, pose[:3], pose[3:], matrix, np.array([k1, k2, 0.0, 0.0]))
        towards = (world - np.array(one.pose.centre)) @ np.array(one.pose.rotation)
        seen = one.place(*towards.T).T / rig.sensor.pixel_pitch + 511.5
        np.testing.assert_allclose(seen, image[:, 0], rtol=0.0, atol=1e-8)
    exported = rig.exported()
    np.testing.assert_array_equal(exported.translation, best[15:])
    np.testing.assert_array_equal(exported.right.focal_lengths, best[6:8])


def test_damaged_files_are_named(tmp_path):
    path = saved(tmp_path / "rig.nc")
    with xarray.open_dataset(path, engine="h5netcdf") as data:
        data.load()
    data["best"].values[3] = np.nan
    data.to_netcdf(tmp_path / "nan.nc", engine="h5netcdf")
    with pytest.raises(CalibrationFileError, match=r"nan\.nc .*: 1 cells .*finite"):
        posterior_of_file(tmp_path / "nan.nc", "rig", stereo())
    data.drop_vars("pixels").to_netcdf(tmp_path / "part.nc", engine="h5netcdf")
    with pytest.raises(CalibrationFileError, match=r"posterior of a rig needs pixels"):
        posterior_of_file(tmp_path / "part.nc", "rig", stereo())
