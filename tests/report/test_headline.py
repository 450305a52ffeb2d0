"""The answer in one sentence."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from tradestudy import load
from tradestudy.results.views import headline as views_headline
from tradestudy.results.views.conclusions import measure_first, never_best, other_words, rests_on
from tradestudy.results.views.headline import answers, headline
from tradestudy.results.views.requirement_conclusions import requirement_conclusions
from tradestudy.study.starter import of_catalogue

STUDIES = Path(__file__).parents[2] / "studies"


def changed(tree: xr.DataTree, best: Sequence[tuple[float, str]], *drop: str) -> xr.DataTree:
    """The tree with other best cameras, each up to a distance [m], and without some groups."""
    decision = tree["decision"].to_dataset().copy(deep=True)
    places = decision["distance"].values
    for end, names in reversed(best):
        decision["best_camera"][{"distance": np.flatnonzero(places <= end)}] = names
    if "crossover_distance" in decision:
        decision["crossover_distance"][:] = np.nan
    others = {name: node.to_dataset() for name, node in tree.children.items() if name not in (*drop, "decision")}
    return xr.DataTree.from_dict({**others, "decision": decision})


@pytest.mark.parametrize(
    ("best", "says"),
    [
        ([(10.0, "r5")], "From 0.05 to 10 m take the Raytrix R5, Keplerian"),
        ([(10.0, "")], "No camera is usable from 0.05 to 10 m"),
        ([(10.0, "r5, stereo-65deg")], "m take the Raytrix R5, Keplerian; or Stereo 100 mm, 65.24° across"),
        ([(1.0, ""), (10.0, "r5")], "; elsewhere none meets the limits"),
    ],
)  # fmt: skip
def test_it_names_who_is_best_where(
    make_tree: Callable[..., xr.DataTree], best: Sequence[tuple[float, str]], says: str
) -> None:
    assert says in headline(changed(make_tree(), best, "requirements", "criteria", "depth_of_field"))


def test_missed_requirements_are_counted(make_tree: Callable[..., xr.DataTree]) -> None:
    tree = make_tree()
    data = tree["requirements"].to_dataset().copy(deep=True)
    data["met"][:] = 0
    data["priority"][:] = "must"
    tree["requirements"] = xr.DataTree(data)
    assert headline(tree).endswith(("; neither requirement is met.", "requirements is met.", "” is not met."))


def test_a_rounded_stretch_lies_within_the_true_one(make_tree: Callable[..., xr.DataTree]) -> None:
    """0.1512 to 0.8288 m is written as 0.152 to 0.828 m everywhere: outside of it, nobody is usable."""
    tree = make_tree()
    depth = tree["depth"].to_dataset().copy(deep=True)
    depth["usable_near"][:], depth["usable_far"][:] = np.nan, np.nan
    depth["usable_near"][{"interval": 0}], depth["usable_far"][{"interval": 0}] = 0.1512, 0.8288
    tree["depth"] = xr.DataTree(depth)
    places = tree["decision"]["distance"].values
    near, far = places[places < 0.1512].max(), places[places < 0.8288].max()
    found = headline(changed(tree, [(near, ""), (far, "r5"), (10.0, "")], "requirements", "criteria", "depth_of_field"))
    assert found == "From 0.152 to 0.828 m take the Raytrix R5, Keplerian; elsewhere none meets the limits."


def test_neighbouring_stretches_end_at_different_distances(make_tree: Callable[..., xr.DataTree]) -> None:
    """1.46 m would be written as 1.5 m, where the next stretch ends."""
    tree = make_tree()
    depth = tree["depth"].to_dataset().copy(deep=True)
    depth["usable_near"][:], depth["usable_far"][:] = np.nan, np.nan
    for name, near, far in (("stereo-65deg", 0.5, 1.46), ("r5", 0.5, 1.5)):
        depth["usable_near"].loc[{"camera": name, "interval": 0}] = near
        depth["usable_far"].loc[{"camera": name, "interval": 0}] = far
    tree["depth"] = xr.DataTree(depth)
    places = tree["decision"]["distance"].values
    ends = [float(places[places < end].max()) for end in (0.5, 1.46, 1.5)]
    best = [*zip(ends, ("", "stereo-65deg", "r5"), strict=True), (10.0, "")]
    found = headline(changed(tree, best, "requirements", "criteria", "depth_of_field"))
    assert re.match(r"From 0.5 to 1.46 m take Stereo 100 mm.*, to 1.5 m the Raytrix R5", found), found


def test_an_unknown_uncertainty_of_the_best_camera_leaves_the_comparison_of_others(
    make_tree: Callable[..., xr.DataTree],
) -> None:
    """Where the best camera is usable and its uncertainty is unknown, others are compared among themselves."""
    tree = make_tree()
    tree["decision"]["best_camera"][:] = "stereo-65deg"
    tree["decision"]["judged_uncertainty"].loc[{"camera": "stereo-65deg"}] = np.nan
    found = dict(never_best(tree))
    assert len(found) == 2
    assert min(found.values()) == 1.0  # the better one of them, somewhere
    assert np.isfinite(list(found.values())).all()
    assert all("is best nowhere" in words for words in other_words(tree))


@pytest.mark.parametrize("baselines", ["60 mm, 100 mm, 140 mm", "100 mm, 140 mm, 180 mm"])
def test_a_sweep_names_the_number_that_decides(baselines: str) -> None:
    """At 1 m, a yaw of 0.2° moves depth by a² φ/b = 34.9 mm with a baseline of 100 mm, whatever the focal length.

    The declared baseline is named, also if it is the first of the sweep.
    """
    swept = [f"sweep.stereo.baseline=[{baselines}]", "sweep.stereo.lenses.focal_length=[8 mm, 16 mm]"]
    study = load(STUDIES / "stereo_design.yaml", ["scene.distances={from: 0.5 m, to: 2 m, points: 7}", *swept])
    said = "For depth by the stereo rig at 1 m, baseline decides and focal length hardly matters: ±35 mm"
    assert answers(study.run().data)[1] == f"{said} with baseline 100 mm."


@pytest.mark.parametrize(
    ("mode", "said"),
    [
        ("", "RealSense D455 at 1280x720: it alone meets both requirements."),
        ("-extended", "OAK-D at 800p-extended: it meets"),
    ],
)
def test_a_camera_that_alone_meets_what_is_required_is_taken(tmp_path: Path, mode: str, said: str) -> None:
    """By its maker, the OAK-D sees nothing nearer than 70 cm, extended than 35 cm; at 1.5 m it is the more certain."""
    study = tmp_path / "bins.yaml"
    study.write_text(of_catalogue("bins", ["realsense-d455", f"oak-d:800p{mode}"]), encoding="utf-8")
    assert headline(load(study, ["scene.distances.points=20"]).run().data).startswith(f"Take the {said}")


def test_no_camera_is_alone_while_another_one_is_undecided(tmp_path: Path) -> None:
    """The OAK-D misses 2 mm at 0.6 m; were that undecided, nobody could say that the D455 alone meets both."""
    study = tmp_path / "bins.yaml"
    study.write_text(of_catalogue("bins", ["realsense-d455", "oak-d:800p"]), encoding="utf-8")
    near, far = requirement_conclusions(load(study, ["scene.distances.points=20"]).run().data)
    by_margin = sorted((near, far), key=lambda one: one.margin)
    assert views_headline._meets_alone(by_margin).startswith("RealSense D455")
    missed = next(one for one in by_margin if any(other.met is False for other in one.others))
    undecided = replace(missed, others=tuple(replace(other, met=None) for other in missed.others))
    assert views_headline._meets_alone([one if one is not missed else undecided for one in by_margin]) == ""


def test_a_camera_that_is_usable_nowhere_is_not_compared() -> None:
    """80 km apart, the lenses of a rig share no picture; the other two cameras are compared."""
    study = load(STUDIES / "robot.yaml", ["stereo-75mm.baseline=80 km", "scene.distances.points=7", "trade_off=null"])
    assert re.search(
        r"; every other usable camera is at least [\d.]+ times as uncertain\.$", headline(study.run().data)
    )


def test_fresnel_limits_are_grouped_by_lens_and_phase(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = [("Main lens", 5.84, 0.0), ("Microlens", np.inf, 0.0), ("Other", np.inf, 2.0)]
    limits = [
        {"element": lens, "lens_phase": phase, "window": 10.0, "limit": 0.1, "f_number": f_number}
        for lens, *f_numbers in asked
        for phase, f_number in zip(("parabolic", "perfect"), f_numbers, strict=True)
    ]
    monkeypatch.setattr(views_headline, "fresnel_numbers", lambda _tree: limits)
    tree = xr.DataTree(xr.Dataset(attrs={"question": ""}))
    assert headline(tree) == (
        "On the axis, Fresnel suffices to 10 % from f/5.9 on (main lens) and at no f-number tried (microlens and "
        "other) with a parabolic phase; at every f-number tried (main lens and microlens) and from f/2 on (other) with "
        "a perfect phase."
    )


def test_pictures_of_a_light_spot_have_their_times(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [
        {"method": method, "reference": "kirchhoff", "difference": difference, "error": 1e-3}
        for method, difference in (("geometric", 0.2), ("kirchhoff", np.nan))
    ]
    monkeypatch.setattr(views_headline, "light_numbers", lambda _tree: rows)
    tree = xr.DataTree(xr.Dataset(attrs={"question": ""}))
    said = headline(tree, {"image: geometric": 0.25, "image: kirchhoff": 90.0})
    assert re.fullmatch(r"Pictures differ from Kirchhoff [^,]+, 90 s, by 20 % \([^,]+, 250 ms\)\.", said)


def test_a_trade_off_that_ranks_another_camera_first_replaces_the_requirement() -> None:
    said = headline(load(STUDIES / "robot.yaml", ["scene.distances.points=20"]).run().data)
    assert re.fullmatch(
        r"For depth alone, take the 75 mm stereo head; every other camera is at least 1\.4 times as uncertain; if "
        r"accuracy, mass and power all count, the 50 mm stereo head ranks first for 6\d % of the possible weights\.",
        said,
    )


def measured(*cameras: tuple[str, float, float, float, float]) -> xr.DataTree:
    """Cameras with spread, its standard error, bias and predicted bias, in millimetres, in pictures of a scene."""
    titles, *numbers = zip(*cameras, strict=True)
    columns = dict(zip(("spread", "spread_error", "bias", "predicted_bias"), numbers, strict=True))
    columns |= {"bias_error": columns["spread_error"], "predicted": columns["spread"], "filled": columns["spread"]}
    values = {f"depth_{name}": ("mapped_camera", 1e-3 * np.array(column)) for name, column in columns.items()}
    cameras_of = xr.Dataset({"title": ("camera", list(titles))}, {"camera": list(titles)})
    pictures = xr.Dataset(values, {"mapped_camera": list(titles)})
    return xr.DataTree.from_dict({"/cameras": cameras_of, "/pictures": pictures})


@pytest.mark.parametrize(
    ("error", "bias", "drawn", "without"),
    [(0.2, 3.0, 4.0, "as well as Head A"), (0.02, 3.0, 4.0, "best"), (0.02, 3.0, 0.0, ""), (0.02, 0.1, 4.0, "")],
)
def test_a_ranking_rests_on_a_drawn_bias_that_alone_decides_it(
    error: float, bias: float, drawn: float, without: str
) -> None:
    """Head A is off by 1.3 mm in all, and Head B spreads by 1.1 mm."""
    tree = measured(("Head A", 1.2, error, 0.5, 0.1), ("Head B", 1.1, error, bias, drawn))
    assert headline(tree).startswith(f"Head {'A' if bias > 1.0 else 'B'} measures the scene best")
    said = f"bias of Head B, one random draw of its calibration errors (without it, the camera would measure {without})"
    assert rests_on(tree) == ((said,) if without else ())
    assert measure_first(tree) == ("Measure first: the calibration of Head B" if without else "")
