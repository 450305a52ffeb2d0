"""A results tree written by hand, small and physically sensible, for the tests of figures and reports.

It is built from the declared table of variables, so that a name which results do not have fails here.
"""

from __future__ import annotations

import json
from dataclasses import asdict

import numpy as np
import xarray as xr

from tradestudy.cameras.focused_plenoptic.design import METHOD as PLENOPTIC
from tradestudy.cameras.stereo.design import METHOD as STEREO
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset

DISTANCE = np.geomspace(0.05, 10.0, 160)
ERROR_SOURCES = ["noise", "calibration", "both"]
QUANTILES = [0.025, 0.15865525393145707, 0.5, 0.8413447460685429, 0.975]
PARTS = ["noise", "relative rotation", "relative position", "interior orientation", "array"]
READINGS = {
    "as declared": "the study as declared",
    "least-squares-all": "every lens that sees the point, all types sharp",
    "galilean": "image behind the array",
    "yaw-uniform": "0.2° is a bound, not a standard deviation",
}
PLACES = [0.3, 0.5, 1.0]
_DIVIDED = ("depth_uncertainty", "depth_error_radius")
Sweep = dict[str, list[float]] | dict[str, list[str]]


def tree(
    *, titles: dict[str, str] | None = None, sweep: Sweep | None = None, declared: dict[str, float] | None = None
) -> xr.DataTree:
    """Build a study of one plenoptic camera and two stereo readings.

    Parameters
    ----------
    titles
        Of the cameras, instead of the usual ones.
    sweep
        Swept values by name: they divide the uncertainty by (place in the list + 1).
    declared
        The declared value of swept names.
    """
    names = {
        "r5": "Raytrix R5, Keplerian",
        "stereo-30mm": "Stereo 100 mm, f = 30.5 mm",
        "stereo-65deg": "Stereo 100 mm, 65.24° across",
    } | (titles or {})
    keys = list(names)
    root = {
        "format_version": 1,
        "study": "synthetic",
        "title": "Raytrix R5 against a stereo rig",
        "question": "Which sensor should measure depth, and at which distance does the answer change?",
    }
    groups = {
        "/": xr.Dataset(attrs=root),
        "/cameras": _cameras(names),
        "/depth": _depth(keys, sweep or {}, declared or {}),
        "/decision": _decision(keys, _depth(keys, {}, {})["depth_uncertainty"].values),
        "/claims": _claims(),
        **_registers(keys),
    }
    return xr.DataTree.from_dict(groups)


def _cameras(names: dict[str, str]) -> xr.Dataset:
    keys = list(names)
    return dataset(
        "cameras",
        {
            "title": list(names.values()),
            "kind": ["focused-plenoptic", "stereo", "stereo"],
            "family": ["plenoptic", "stereo", "stereo"],
            "method": [json.dumps(asdict(method)) for method in (PLENOPTIC, STEREO, STEREO)],
            "note": ["as in section 6", "as printed", "65.24° taken as right"],
            "focal_length": [12.5e-3, 30.5e-3, 8e-3],
            "f_number": [3.8, 8.0, 8.0],
            "baseline": [3.29e-3, 0.1, 0.1],
            "pixels_across": [2048.0, 1024.0, 1024.0],
            "pixels_down": [2048.0, 1024.0, 1024.0],
            "pixel_pitch": [5.5e-6, 10e-6, 10e-6],
            "field_of_view": [0.848, 0.332, 1.138],
            "property_camera": [keys[0], keys[1], keys[2]],
            "property_name": ["microlens gap", "field of view across", "field of view across"],
            "property_value": [0.568e-3, 0.3327, 1.1387],
            "property_units": ["m", "rad", "rad"],
            "property_words": [""] * 3,
        },
        {"camera": keys},
    )


def _depth(keys: list[str], sweep: Sweep, declared: dict[str, float]) -> xr.Dataset:
    z = DISTANCE
    noise = np.stack([0.12 * z**2, 1.8e-4 * z**2, 6.9e-4 * z**2])
    calibration = np.stack([0.006 * z**2, 0.0349 * z**2, 0.0349 * z**2])
    both = np.hypot(noise, calibration)
    by_error_source = np.stack([noise, calibration, both], axis=-1)
    # Of the stereo rigs' calibration the rotation has 90 % and the position 10 %; on the axis the array moves no depth.
    share = np.full((*noise.shape, len(PARTS)), np.nan)
    share[..., 0] = noise**2 / both**2
    share[1:, :, 1], share[1:, :, 2] = 0.9 * (1.0 - share[1:, :, 0]), 0.1 * (1.0 - share[1:, :, 0])
    share[0, :, 3], share[0, :, 4] = 1.0 - share[0, :, 0], 0.0
    near, far = np.array([0.15, 1.489, 0.391]), np.array([1.0, 10.0, 10.0])
    step_far = np.where(z > 7.0, np.inf, both * 1.1)
    farther = np.where(np.arange(3)[:, None] == 0, step_far, noise * 1.05)
    values = {
        "depth_discrimination": np.stack([noise, farther], axis=-1),
        "depth_uncertainty": both,
        "depth_uncertainty_by_error_source": by_error_source,
        "depth_uncertainty_by_error_source_error": 0.004 * by_error_source,
        "variance_share": share,
        "converged": np.ones_like(both, dtype=bool),
        "depth_quantile": z[None, :, None, None] + by_error_source[..., None] * np.array([-1.96, -1, 0, 1, 1.96]),
        "depth_uncertainty_error": 0.004 * both,
        "depth_error_radius": 0.999 * both,
        "depth_error_radius_error": 0.004 * both,
        "depth_error_radius_by_error_source": 0.999 * by_error_source,
        "depth_error_radius_by_error_source_error": 0.004 * by_error_source,
        "equivalent_baseline": np.stack([np.full_like(z, b) for b in (3.6e-4, 0.1, 0.1)]),
        "failed_fraction": np.where(by_error_source > 3.0, 0.02, 0.0),
        "failed_fraction_error": np.zeros_like(by_error_source),
        "usable": (z >= near[:, None]) & (z <= far[:, None]),
        "limit_met": np.stack([z >= near[:, None], z <= far[:, None]], axis=-1).astype(np.int8),
        "limit_value": np.ones((*both.shape, 2)),
        "usable_near": near[:, None],
        "usable_far": far[:, None],
        "near_limit": np.array([["total_covering_plane"], ["overlap"], ["overlap, focus"]]),
        "far_limit": np.array([["relative_uncertainty"], ["range of the study"], ["range of the study"]]),
    }
    for axis, numbers in enumerate(sweep.values()):
        factor = np.arange(1.0, len(numbers) + 1)
        values = {
            name: np.stack(
                [array / f for f in factor] if name.startswith(_DIVIDED) else [array] * len(factor),
                axis=axis,
            )
            for name, array in values.items()
        }
    coordinates = {
        "camera": keys,
        "distance": z,
        "side": ["nearer", "farther"],
        "error_source": ERROR_SOURCES,
        "part": PARTS,
        "limit": ["overlap", "focus"],
    }
    data = dataset("depth", values, coordinates | {"quantile": QUANTILES} | sweep, leading=tuple(sweep))
    for name in sweep:
        data[name].attrs = {"units": "m", "long_name": name, "path": name} | {
            k: v for k, v in [("declared", declared.get(name))] if v
        }
    return data


def _decision(keys: list[str], judged: FloatArray) -> xr.Dataset:
    best = np.where(DISTANCE < 0.15, "", np.where(DISTANCE < 0.391, keys[0], keys[2]))
    by_error_source, by_place = np.array([20.0, 0.2, 1.0]), np.array([1.0, 1.1, 1.2])[:, None]
    ratio = np.array([3.4, 0.9, 5.0, 6.0])[:, None, None] * by_place * by_error_source
    certain = np.where(ratio < 1, keys[0], keys[2])
    winner = np.where(np.array(PLACES)[:, None] < 0.391, keys[0], certain)
    values = {
        "best_camera": np.repeat(best[:, None], 3, axis=1),
        "judged_uncertainty": judged,
        "reading_says": list(READINGS.values()),
        "uncertainty_ratio": ratio,
        "winner": winner,
        "more_certain": certain,
        "within_tolerance": np.zeros(winner.shape),
        "flips": winner != winner[:1],
        "certainty_flips": certain != certain[:1],
        "change_distance": np.repeat(np.array([[[0.391]], [[0.391]], [[0.52]], [[np.nan]]]), 3, axis=1),
        "change_error": np.repeat(np.array([[[0.0]], [[0.0]], [[0.0]], [[np.nan]]]), 3, axis=1),
        "change_nearer": np.repeat(np.array([[[keys[0]]]] * 3 + [[[""]]]), 3, axis=1),
        "change_farther": np.repeat(np.array([[[keys[2]]]] * 3 + [[[""]]]), 3, axis=1),
        "crossover_distance": np.repeat(np.array([[[np.nan]], [[0.52]], [[0.4]], [[np.nan]]]), 3, axis=1),
        "crossover_error": np.repeat(np.array([[[np.nan]], [[0.0]], [[0.0]], [[np.nan]]]), 3, axis=1),
        "crossover_nearer": np.repeat(np.array([[[""]], [[keys[0]]], [[keys[0]]], [[""]]]), 3, axis=1),
        "solved_value": [0.0119, np.nan],
        "solved_error": [1e-5, np.nan],
        "solved_units": ["rad", "m"],
        "solved_says": ["Which yaw makes stereo equal the R5 at 0.5 m?", "Which baseline does?"],
        "solved_answer": ["0.682°", "nowhere between 50 mm and 200 mm"],
    }
    coordinates = {
        "camera": keys,
        "distance": DISTANCE,
        "error_source": ERROR_SOURCES,
        "reading": list(READINGS),
        "place": PLACES,
        "question": ["yaw", "b"],
    }
    return dataset("decision", values, coordinates, attributes={"first": keys[0], "second": keys[2]})


def _claims() -> xr.Dataset:
    values = {
        "value": np.array([[0.391, np.nan, np.nan, 0.391], [6.8, np.nan, 36.0, np.nan]]),
        "met": np.array([[0, -1, -1, 0], [1, -1, 0, -1]]),
        "value_text": np.array([["391 mm", "", "", "391 mm"], ["6.8 m", "", "36 m", ""]]),
        "reading_says": list(READINGS.values()),
        "says": ["stereo from about 0.5 m", "range limited to 7 m"],
        "source": ["section 6", "section 6"],
        "expected": ["0.5 m ± 25 %", "7 m ± 7.2 %"],
        "quantity": ["near end of the overlap limit", "far end of the last disparity step limit"],
        "tolerance_reason": ["one digit and ≈", "one digit"],
        "verdict": ["not met", "cannot be decided from its source"],
        "reason": ["under no reading tried (2)", "met under as declared; not met under galilean"],
    }
    return dataset("claims", values, {"claim": ["C1", "C4"], "reading": list(READINGS)})


def _registers(keys: list[str]) -> dict[str, xr.Dataset]:
    criteria = np.array([["0", "1"], ["0", "2"], ["0", "2"]], dtype=object)
    return {
        "/assumptions": dataset(
            "assumptions",
            {
                "value": ["0.2°", "0.568 mm"],
                "basis": ["paper", "assumed"],
                "note": ["", "f-number matching"],
                "cameras": ["stereo-30mm, stereo-65deg", keys[0]],
            },
            {"path": ["calibration.errors.yaw", "microlenses.gap"]},
        ),
        "/contradictions": dataset(
            "contradictions",
            {
                "camera": ["stereo-30mm"],
                "what": ["field of view"],
                "stated": ["65.24°"],
                "implied": ["19.06°"],
                "used": ["focal length as printed"],
            },
            {},
        ),
        "/requirements": dataset(
            "requirements",
            {
                "says": ["below 2 % from 0.1 m to 0.4 m", "any camera at 1 m"],
                "priority": ["must", "should"],
                "quantity": ["depth_uncertainty", "depth_uncertainty"],
                "of": [keys[0], "any"],
                "met": [0, 1],
                "camera_deciding": [keys[0], keys[2]],
                "value": [0.05, 0.035],
                "value_error": [0.001, np.nan],
                "bound": [0.02, 0.04],
                "bound_is_relative": [1, 0],
                "bound_text": ["at most 2 % of the distance", "at most 40 mm"],
                "over_near": [0.1, 1.0],
                "over_far": [0.4, 1.0],
                "place": [0.1, 1.0],
                "margin_percent": [-60.0, 12.0],
                "margin_sigma": [-30.0, np.nan],
                "conformity": [0.0, 1.0],
                "within_tolerance": [0.0, 0.0],
                "reason": ["not usable at 0.1 m", "worst 3.5 % at 1 m"],
                "limited_by": ["overlap", ""],
                "rests_on": ["yaw of a rig, assumed 0.2 deg", ""],
                "rests_on_basis": ["assumed", ""],
                "rests_on_share": [0.9, np.nan],
            },
            {"requirement": ["close", "mid"]},
        ),
        "/criteria": xr.Dataset(
            {"value": (("camera", "criterion"), criteria)},
            coords={"camera": keys, "criterion": ["moving_parts", "images_per_scene"]},
        ),
    }
