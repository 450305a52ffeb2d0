"""Studies of calibrated cameras from their file to results: one depth, and it follows from the posterior."""

from functools import partial

import numpy as np
import pytest
import xarray
from typer.testing import CliRunner

import tradestudy
from tests.calibration import plain_cameras
from tests.calibration.cameras import unfocused
from tests.calibration.conftest import STUDY
from tradestudy import api
from tradestudy.cameras.depth_measurement import CORNERS
from tradestudy.cli import app
from tradestudy.figures import build
from tradestudy.report.contents import compose_report
from tradestudy.report.document import Callout, Paragraph, all_blocks, spans
from tradestudy.report.sections.answer import describe_answer

pytestmark = pytest.mark.usefixtures("empty_figures")

PLAIN = {
    "rig": (plain_cameras.stereo, 1e-6),  # and the standard deviation of its disparity [m]
    "r5": (plain_cameras.focused, 0.55e-6),
    "views": (partial(plain_cameras.unfocused, pixels_apart=unfocused().pixels_apart), 12.65e-6),
}
CENTRAL = (0.158655, 0.841345)


def plain(text):
    return "".join(span.text for span in spans(text))


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """The small study run by its command, strictly: its folder and what was found."""
    folder = tmp_path_factory.mktemp("small")
    (folder / "small.yaml").write_text(STUDY, encoding="utf-8")
    command = ["run", str(folder / "small.yaml"), "--out", str(folder / "out"), "--no-pdf", "--quiet", "--strict"]
    ended = CliRunner().invoke(app, command)
    (folder / "said.txt").write_text(f"{ended.exit_code}\n{ended.output}", encoding="utf-8")
    return folder, api.open_result(folder / "out")


def group(result, name):
    return result.data[name].to_dataset()


def test_the_calibration_group_contains_posteriors_with_their_diagnostics(ran):
    found = group(ran[1], "calibration")
    assert list(found["posterior"].values) == list(PLAIN)
    assert found["posterior_converged"].values.tolist() == [True, False, True]
    assert set(found["posterior_kind"].values) == {"simulated target"}
    known = found["posterior_mean"].notnull()
    assert known.sum("parameter").values.tolist() == [7, 3, 3]
    for name in ("posterior_deviation", "posterior_r_hat", "posterior_bulk_size", "posterior_tail_size"):
        assert (found[name].where(known) > 0.0).sum() == 13, name
    learnt = found["posterior_deviation"] / found["prior_deviation"]
    assert learnt.max() < 1.2  # to the sampling error of chains that are too short
    assert learnt.sel(posterior="rig", parameter="yaw") < 0.5
    errors = found["posterior_deviation"] / np.sqrt(found["posterior_bulk_size"])
    np.testing.assert_allclose(found["posterior_mean_error"].values[known], errors.values[known], rtol=1e-12)
    draws = found["posterior_draw"]
    off = (draws.mean("draw") - found["posterior_mean"]) / found["posterior_deviation"]
    assert np.abs(off.values[known]).max() < 0.05
    assert not {"depth_quantile", "depth_uncertainty"} & set(found.data_vars)  # these are /depth's alone


def depths_of_rows(camera, posterior, distance, *, noisy):
    """Inverse depths that the saved draws read, each under noise 48 times or without; shape (readings, distances)."""
    read, deviation = PLAIN[camera]
    draws = posterior["draws"].values
    names = [str(name.decode() if isinstance(name, bytes) else name) for name in posterior["parameter"].values]
    errors = dict(zip(names, (draws - draws.mean(axis=0)).T[..., None], strict=True))
    shape = (48 if noisy else 1, len(draws), distance.size)
    noise = np.random.default_rng(0).normal(0.0, deviation if noisy else 0.0, shape)
    return np.concatenate([read({}, errors, distance, once) for once in noise])


@pytest.mark.parametrize("camera", PLAIN)
@pytest.mark.parametrize("error_source", ["calibration", "both"])
def test_depth_is_what_plain_numpy_triangulates_from_the_saved_draws(ran, camera, error_source):
    folder, result = ran
    found = group(result, "depth").sel(camera=camera, error_source=error_source)
    with xarray.open_dataset(folder / "out" / "posteriors" / f"{camera}.nc", engine="h5netcdf") as posterior:
        inverse = depths_of_rows(camera, posterior, found["distance"].values, noisy=error_source == "both")
    far, near = (1.0 / np.quantile(inverse, p, axis=0) for p in CENTRAL)
    expected = (far - near) / 2.0
    allowed = 0.01 * expected + 3.0 * found["depth_uncertainty_by_error_source_error"].values
    np.testing.assert_array_less(np.abs(found["depth_uncertainty_by_error_source"].values - expected), allowed)
    np.testing.assert_allclose(found["failed_fraction"].values, np.mean(inverse <= 0.0, axis=0), atol=1e-3)
    if error_source == "both":
        assert np.array_equal(found["depth_uncertainty"].values, found["depth_uncertainty_by_error_source"].values)


def test_the_posterior_in_the_results_is_the_one_in_the_file(ran):
    folder, result = ran
    draws = group(result, "calibration")["posterior_draw"]
    for camera in PLAIN:
        with xarray.open_dataset(folder / "out" / "posteriors" / f"{camera}.nc", engine="h5netcdf") as posterior:
            own = draws.sel(posterior=camera).dropna("parameter", how="all").dropna("draw")
            # The file holds errors: the draws relative to one set of values, with the same digits.
            errors = posterior["draws"].values
            shift = own.values - errors
            np.testing.assert_allclose(shift, np.broadcast_to(shift[0], shift.shape), rtol=0.0, atol=1e-15)
            assert np.all(np.abs(errors.mean(axis=0)) < 0.1 * errors.std(axis=0))
            assert not posterior["reference"].values.any()


def test_sensitivity_is_computed_at_the_requested_distance(ran):
    found = group(ran[1], "sensitivity")
    assert found["distance"].values.tolist() == [1.0]
    assert found["field"].values.tolist() == [0.0, 0.5]
    assert list(found["source"].values) == ["pixel_noise", "calibration"]
    # Of two independent sources depth is little but their sum: their shares of its variance are the indices.
    total = found["first_index"].sum("source")
    np.testing.assert_allclose(total.values, 1.0, atol=0.03)
    alone = found["source_uncertainty"] ** 2
    np.testing.assert_allclose(found["first_index"].values, (alone / alone.sum("source")).values, atol=0.03)


def test_depth_off_the_axis_is_computed_at_the_requested_places(ran):
    axis, beside = group(ran[1], "depth"), group(ran[1], "depth_field")
    assert beside["field"].values.tolist() == [0.5]
    assert np.array_equal(beside["distance"].values, axis["distance"].values)
    np.testing.assert_allclose(beside["variance_share"].sum("part").values, 1.0, atol=1e-9)
    assert list(beside["corner"].values) == list(CORNERS)
    # Pitch and roll act off the axis alone; noise of a parallel pair is the same everywhere.
    ratio = (beside["depth_uncertainty_by_error_source"] / axis["depth_uncertainty_by_error_source"]).sel(
        camera="rig", field=0.5
    )
    assert (ratio.sel(error_source="calibration").max("corner") > 1.003).all()  # correlations make one side better
    np.testing.assert_allclose(ratio.sel(error_source="noise").values, 1.0, rtol=1e-3)


def test_a_posterior_of_one_run_gives_another_study_the_same_depth_bit_for_bit(ran):
    folder, result = ran
    changes = [
        f"{camera}.calibration={{posterior: {{file: out/posteriors/{camera}.nc}}, errors: null, target: null}}"
        for camera in PLAIN
    ]
    again = tradestudy.load(folder / "small.yaml", [*changes, "effects={calibration: exact}"]).run()
    assert "calibration" not in again.data.children  # nothing was inferred
    for name in ("depth", "depth_field"):
        xarray.testing.assert_identical(
            group(again, name).drop_attrs(deep=False), group(result, name).drop_attrs(deep=False)
        )


def test_an_unconverged_calibration_is_reported_and_fails_a_strict_run(ran):
    folder, result = ran
    (unmet,) = result.unmet_requirements
    assert unmet.startswith("calibrations did not converge for R5 (")
    assert "converge" in unmet
    assert "steps/τ" in unmet
    status, said = (folder / "said.txt").read_text(encoding="utf-8").splitlines()
    assert (status, said) == ("3", f"requirements not met: {unmet}")
    (told,) = [line for line in result.lines() if line.startswith("Not converged")]
    assert told.startswith("Not converged: the calibration of R5 (")
    assert "too short" in told
    drawings = build(result.data)
    assert {"corner-rig", "corner-r5", "trace-r5", "trace-views"} <= set(drawings)
    blocks = tuple(all_blocks(compose_report(result.data, {}, drawings).blocks))
    first = "".join(plain(one.text) for one in all_blocks(describe_answer(result.data)) if isinstance(one, Paragraph))
    assert "Not converged: the calibration of R5 (" in first
    warnings = [block for block in blocks if isinstance(block, Callout) and block.tone == "warning"]
    assert [plain(warning.title) for warning in warnings] == ["Unusual values", "R5 did not converge"]
    words = [plain(block.text) for block in all_blocks(warnings[1].blocks) if isinstance(block, Paragraph)]
    assert "too short" in words[0]
    assert "R5 did not converge" in (folder / "out" / "report.html").read_text(encoding="utf-8")
