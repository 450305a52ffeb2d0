"""No number stands in the results for nothing: what is NaN or infinite says why where it is declared."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

import tradestudy
from tradestudy import api

STUDIES = Path(__file__).parents[2] / "studies"
SAYS_NAN, SAYS_INFINITE = re.compile("NaN|not a number"), re.compile("infinit|∞")


def unexplained(tree: xr.DataTree) -> list[str]:
    """Variables that hold a NaN or an infinity and do not say when they may."""
    found = []
    for group in tree.children:
        for name, variable in tree[group].to_dataset().data_vars.items():
            if variable.dtype.kind != "f":
                continue
            words = " ".join(str(variable.attrs.get(key, "")) for key in ("comment", "error"))
            if np.isnan(variable.values).any() and not SAYS_NAN.search(words):
                found.append(f"{group}/{name}: NaN")
            if np.isinf(variable.values).any() and not SAYS_INFINITE.search(words):
                found.append(f"{group}/{name}: infinite")
    return found


@pytest.fixture(scope="module")
def starter(tmp_path_factory: pytest.TempPathFactory) -> xr.DataTree:
    path = tmp_path_factory.mktemp("starter") / "starter.yaml"
    path.write_text(tradestudy.starter("starter"), encoding="utf-8")
    # Far enough for intervals without a far end, and one blur that nothing meets.
    changed = ("scene.distances.points=30", "scene.distances.to=1 km", "usable_range.blur=0.01 px")
    return api.load(path, changed).run().data


def test_results_that_are_not_finite_give_a_reason(starter: xr.DataTree) -> None:
    assert unexplained(starter) == []
    assert np.isinf(starter["depth"]["depth_uncertainty"].values).any()
    assert np.isnan(starter["depth"]["variance_share"].values).any()


def test_results_that_are_not_sharp_give_a_reason() -> None:
    changed = ("scene.distances.points=5", "depth_of_field.range=[20 mm, 10 m]")
    tree = api.load(STUDIES / "hand_lens.yaml", changed).run().data
    assert unexplained(tree) == []
    data = tree["depth_of_field"].to_dataset()
    empty = data["extent"].values == 0.0
    assert empty.any()
    assert all(data["reason"].values[empty])


def test_hard_cases_explain_every_missing_number() -> None:
    study = api.load(STUDIES / "hard_cases.yaml", ("hard_cases.families=[thin-lens, depth-of-field, propagation]",))
    tree = study.run().data
    assert unexplained(tree) == []
    data = tree["hard_cases"].to_dataset()
    assert data["met"].values.all()
    assert (np.isnan(data["our_error"].values) == data["outcome"].values.astype(bool)).all()
    assert set(tree.children) >= {"hard_cases"}
    assert api.Study.check_summary(study).startswith("hard-cases")
