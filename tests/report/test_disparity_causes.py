"""Why a derived disparity error is what it is, from the study of the hand lens to its report."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tradestudy import load
from tradestudy.answers.disparity_causes import disparity_causes_group
from tradestudy.answers.registers import cameras_group
from tradestudy.imaging.picture import CHANGES
from tradestudy.models.plan import plan_of
from tradestudy.report.contents import compose_report
from tradestudy.report.document import Block, Table, Text, all_blocks, spans
from tradestudy.report.sections.results import describe_disparity_causes
from tradestudy.results import GROUPS
from tradestudy.study.loading import load_prepared

STUDY = Path(__file__).parents[2] / "studies" / "close_range.yaml"
QUICK = ("scene.distances.points=39",)
NAME = "disparity-causes-table"


def causes(*changes: str) -> xr.Dataset:
    found = disparity_causes_group(plan_of(load_prepared(STUDY, (*QUICK, *changes))).study)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def found() -> xr.Dataset:
    return causes()


def section(found: xr.Dataset) -> tuple[Block, ...]:
    cameras = cameras_group(load_prepared(STUDY, QUICK))
    return section_of(xr.DataTree.from_dict({"/cameras": cameras, "/disparity_causes": found}))


def section_of(tree: xr.DataTree) -> tuple[Block, ...]:
    return tuple(describe_disparity_causes(tree))


def plain(text: Text) -> str:
    return "".join(span.text for span in spans(text)).replace("\u00a0", " ")


def rows(blocks: tuple[Block, ...]) -> list[list[str]]:
    (table,) = (block for block in blocks if isinstance(block, Table) and block.name == NAME)
    return [[plain(cell) for cell in row] for row in table.rows]


def test_the_largest_numerical_error_names_camera_and_place(found: xr.Dataset) -> None:
    (table,) = (block for block in section(found) if isinstance(block, Table) and block.name == NAME)
    reported = re.search(r"Estimated numerical error: at most (\S+) % \((.+) at (.+)\)\.$", plain(table.notes[0]))
    assert reported is not None
    relative = {
        (camera, place): max(
            float((found[f"{name}_error"] / found[name]).sel(camera=camera, distance=place).max())
            for name in ("disparity_error_px", "disparity_error_px_changed")
        )
        for camera in found["camera"].values
        for place in found["distance"].values
    }
    camera, place = max(relative, key=lambda key: relative[key])
    assert float(reported[1]) == pytest.approx(100.0 * relative[camera, place], rel=0.05)
    assert reported[2] == load_prepared(STUDY, QUICK).file.cameras[camera].title
    assert reported[3] == f"{1e3 * place:g} mm"


# ---- the numbers ----------------------------------------------------------------------------------------------------


def test_light_follows_the_f_number_and_diffraction_counts_more_at_the_smaller_aperture(found: xr.Dataset) -> None:
    assert list(found["camera"].values) == ["pair-f9.8", "pair-f22", "pair-f5.6"]  # the declared one has no picture
    assert found["distance"].values == pytest.approx([53e-3, 55.3e-3, 58e-3])
    light = found["electrons"]
    np.testing.assert_allclose(light.sel(camera="pair-f9.8") / light.sel(camera="pair-f22"), (22 / 9.8) ** 2, rtol=1e-9)
    assert set(found["brightest_camera"].values) == {"pair-f5.6"}
    without = found["disparity_error_px"] / found["disparity_error_px_changed"].sel(change="no diffraction")
    assert bool((without.sel(camera="pair-f22") > 1.4 * without.sel(camera="pair-f9.8")).all())


def test_in_the_light_of_the_brightest_cameras_of_one_cone_are_one() -> None:
    """Without diffraction and blur only light distinguishes them, apart from how finely the band is divided."""
    found = causes("effects={main_lens_diffraction: off, defocus_blur: off}")
    lit = found["disparity_error_px_changed"].sel(camera=["pair-f22", "pair-f9.8"], change="light of the brightest")
    own = found["disparity_error_px"].sel(camera="pair-f5.6")
    np.testing.assert_allclose(lit, np.broadcast_to(own, lit.shape), rtol=1e-4)
    assert np.isnan(found["disparity_error_px_changed"].sel(camera="pair-f5.6", change="light of the brightest")).all()


def test_a_saturated_camera_is_not_the_brightest_and_without_a_decision_four_places_are_shown() -> None:
    changes = (*QUICK, "decision=null", "scene.picture.light.electrons=8000 electrons")
    found = disparity_causes_group(load_prepared(STUDY, changes))  # light does not wait for models to be chosen
    assert found is not None
    assert set(found["brightest_camera"].values) == {"pair-f9.8"}
    assert found["distance"].values == pytest.approx(
        [42e-3, 52e-3, 65e-3, 80e-3]
    )  # of the study, nearest to four evenly spaced ones


def test_causes_do_not_depend_on_the_models_chosen_for_depth() -> None:
    """A loose tolerance leaves out diffraction at the microlenses; as a cause of the error it stays."""
    loose = load_prepared(STUDY.with_name("robot.yaml"), ("accuracy.tolerance=100 %",))
    applied = plan_of(loose).study
    assert applied.choices.models["raytrix-r5"]["microlens_diffraction"] == "off"
    found, expected = disparity_causes_group(applied), disparity_causes_group(loose)
    assert found is not None
    xr.testing.assert_allclose(found, expected)


def test_every_variable_is_declared_and_has_an_error(found: xr.Dataset) -> None:
    of_a_matcher = {"matched_error_px", "matched_error_px_error", "matcher", "false_matches"}  # none is declared
    assert set(found.data_vars) == set(GROUPS["disparity_causes"]) - of_a_matcher
    assert list(found["change"].values) == list(CHANGES)
    for name in ("disparity_error_px", "disparity_error_px_changed"):
        share = (found[f"{name}_error"] / found[name]).values
        assert np.nanmax(share) < 0.01
        assert np.nanmin(share) > 0.0


# ---- the words ------------------------------------------------------------------------------------------------------


def bold(blocks: tuple[Block, ...]) -> list[list[str]]:
    """The bold cells of every row of the table that is about a camera."""
    (table,) = (block for block in blocks if isinstance(block, Table) and block.name == NAME)
    return [[plain(cell) for cell in row if spans(cell)[0].style == "strong"] for row in table.rows if len(row) > 1]


def test_the_table_shows_every_cause_and_marks_the_one_that_counts_most() -> None:
    data = load(STUDY, QUICK).run().data
    found = data["disparity_causes"].to_dataset()
    depth = data["depth_at_places"].to_dataset().sel(camera=found["camera"])
    np.testing.assert_allclose(found["disparity_error_px"], depth["disparity_error_px"], rtol=1e-12)
    blocks = tuple(all_blocks(compose_report(data, {}, {}).blocks))
    one = found.sel(camera="pair-f22").isel(distance=1)
    error, changed = float(one["disparity_error_px"]), one["disparity_error_px_changed"]
    table = rows(blocks)
    assert [row[0] for row in table if len(row) == 1] == ["At 53 mm", "At 55.3 mm", "At 58 mm"]
    assert table[6][:4] == ["f/22 pair", "799", "20.1", f"{error:.3g}"]  # 0.3 mm on the object
    shown = {
        name: f"{value:.3g} ({error / value:.3g}×)"
        for name in ("no diffraction", "light of the brightest")
        for value in [float(changed.sel(change=name))]
    }
    assert table[6][5:7] == list(shown.values())
    assert table[7][6] == "itself"
    # Of the other causes, the brightest light divides the error of f/22 most; f/5.6 has it already.
    marked = bold(blocks)
    assert marked[4] == [shown["light of the brightest"]]
    assert marked[5] == [table[7][5]]


def test_declared_errors_have_no_causes(tree: xr.DataTree) -> None:
    declared = (
        load(
            STUDY,
            (*QUICK, *(f"pair-f{n}.depth.disparity_error=0.1 px" for n in ("9.8", "22", "5.6"))),
        )
        .run()
        .data
    )
    for one in (declared, tree):
        assert "disparity_causes" not in one.children
        blocks = tuple(all_blocks(compose_report(one, {}, {}).blocks))
        assert not any(isinstance(block, Table) and block.name == NAME for block in blocks)


def test_a_camera_alone_is_compared_with_none(found: xr.Dataset) -> None:
    found = found.sel(camera=["pair-f5.6"]).copy(deep=True)
    found["brightest_camera"][:] = ""
    blocks = section(found)
    assert {len(row) for row in rows(blocks)} == {1, 7}


def test_larger_equal_and_missing_errors_are_described(found: xr.Dataset) -> None:
    found = found.sel(camera=["pair-f9.8"]).copy(deep=True)
    found["disparity_error_px"][:] = [[np.nan, 0.04, np.inf]]
    found["disparity_error_px_changed"][:] = [
        [[np.nan] * 4, [0.0399, 0.05, np.nan, 0.01], [0.02, np.inf, np.nan, np.inf]]
    ]
    blocks = section(found)
    assert rows(blocks)[1][1:] == ["—", "—", "no picture", "—", "—", "—"]
    assert rows(blocks)[3][3:] == ["0.04", "0.0399 (1×)", "0.05 (0.8×)", "0.01 (4×)"]
    assert rows(blocks)[5][3:] == ["∞", "0.02 (∞×)", "∞ (1×)", "∞ (1×)"]
    assert bold(blocks) == [[], [], ["0.02 (∞×)"]]
    noiseless = found.isel(distance=[1]).copy(deep=True)
    noiseless["disparity_error_px"][:], noiseless["disparity_error_px_changed"][:] = 0.0, [[[0.0, 0.01, np.nan, 0.0]]]
    assert bold(section(noiseless)) == [[]]
