"""A results tree written by hand, small and physically sensible, for the tests of figures and reports."""

from __future__ import annotations

import numpy as np
import xarray as xr

DISTANCE = np.geomspace(0.05, 10.0, 240)
WAYS = ["noise", "calibration", "both"]
QUANTILES = [0.025, 0.15865, 0.5, 0.84135, 0.975]
PARTS = ["pixel_noise", "yaw", "baseline", "mla_distance"]
LIMITS = ["overlap", "focus", "total_covering_plane", "last_step"]


def tree(*, titles: dict[str, str] | None = None, sweep: dict[str, list[float]] | None = None) -> xr.DataTree:
    """A study of one plenoptic camera and two stereo readings; `sweep` adds dimensions to ``/depth``."""
    names = {
        "r5": "Raytrix R5, Keplerian",
        "stereo-30mm": "Stereo 100 mm, f = 30.5 mm",
        "stereo-65deg": "Stereo 100 mm, 65.24° across",
    } | (titles or {})
    keys = list(names)
    groups = {
        "/": xr.Dataset(
            attrs={
                "format_version": 1,
                "study": "synthetic",
                "title": "Raytrix R5 against a 100 mm stereo rig",
                "question": "Which sensor should measure depth, and at which distance does the answer change?",
            }
        ),
        "/cameras": xr.Dataset(
            {
                "title": ("camera", [names[k] for k in keys]),
                "kind": ("camera", ["focused-plenoptic", "stereo", "stereo"]),
                "family": ("camera", ["plenoptic", "stereo", "stereo"]),
            },
            coords={"camera": keys},
        ),
        "/depth": _depth(keys, sweep or {}),
        "/decision": _decision(keys),
        **_registers(keys),
    }
    return xr.DataTree.from_dict(groups)


def _depth(keys: list[str], sweep: dict[str, list[float]]) -> xr.Dataset:
    z = DISTANCE
    noise = np.stack([0.12 * z**2, 1.8e-4 * z**2, 6.9e-4 * z**2])
    calibration = np.stack([0.006 * z**2, 0.0349 * z**2, 0.0349 * z**2])
    both = np.hypot(noise, calibration)
    way = np.stack([noise, calibration, both], axis=-1)
    part = np.full((*noise.shape, len(PARTS)), np.nan)
    part[..., 0] = noise
    part[1:, :, 1], part[1:, :, 2], part[0, :, 3] = calibration[1:], 0.001 * z, calibration[0]
    near, far = np.array([0.15, 1.489, 0.391]), np.array([1.0, 10.0, 10.0])
    step_far = np.where(z > 7.0, np.inf, both * 1.1)
    discrimination = np.stack([noise, np.where(np.arange(3)[:, None] == 0, step_far, noise * 1.05)], axis=-1)
    usable = (z >= near[:, None]) & (z <= far[:, None])
    over = ("camera", "distance")
    data = xr.Dataset(
        {
            "depth_discrimination": ((*over, "side"), discrimination),
            "depth_uncertainty": (over, both),
            "depth_uncertainty_way": ((*over, "way"), way),
            "depth_uncertainty_part": ((*over, "part"), part),
            "depth_quantile": (
                (*over, "way", "quantile"),
                z[None, :, None, None] + way[..., None] * np.array([-1.96, -1, 0, 1, 1.96]),
            ),
            "failed_fraction": ((*over, "way"), np.zeros_like(way)),
            "equivalent_baseline": (
                over,
                np.stack([np.full_like(z, 3.6e-4), np.full_like(z, 0.1), np.full_like(z, 0.1)]),
            ),
            "usable": (over, usable),
            "usable_near": (("camera", "interval"), near[:, None]),
            "usable_far": (("camera", "interval"), far[:, None]),
            "near_limit": (
                ("camera", "interval"),
                np.array([["total_covering_plane"], ["overlap"], ["overlap"]], dtype=object),
            ),
            "far_limit": (
                ("camera", "interval"),
                np.array([["relative_uncertainty"], [""], [""]], dtype=object),
            ),
        },
        coords={
            "camera": keys,
            "distance": z,
            "side": ["nearer", "farther"],
            "way": WAYS,
            "part": PARTS,
            "quantile": QUANTILES,
            "interval": [0],
        },
    )
    for name, unit in (("distance", "m"), ("depth_uncertainty", "m"), ("depth_discrimination", "m")):
        data[name].attrs["units"] = unit
    for name, values in sweep.items():
        factors = xr.DataArray(np.asarray(values) / values[0], dims=name, coords={name: values})
        scaled = {
            v: data[v] / factors for v in ("depth_uncertainty", "depth_uncertainty_way", "depth_uncertainty_part")
        }
        data = data.assign({v: array.transpose(name, ...) for v, array in scaled.items()})
    return data


READINGS = {
    "as declared": "same-type pair, Keplerian, 0.2° as a standard deviation",
    "all-lens least squares": "every lens that sees the point, all types sharp",
    "Galilean relay": "image behind the array",
    "uniform yaw": "0.2° as a bound, not a standard deviation",
}
PLACES = [0.3, 0.5, 1.0]


def _decision(keys: list[str]) -> xr.Dataset:
    best = np.where(DISTANCE < 0.15, "", np.where(DISTANCE < 0.391, keys[0], keys[2]))
    ratio = (
        np.array([3.4, 0.9, 5.0, 6.0])[:, None, None] * np.array([1.0, 1.1, 1.2])[:, None] * np.array([20.0, 0.2, 1.0])
    )
    winner = np.where(ratio < 1, keys[0], keys[2]).astype(object)
    return xr.Dataset(
        {
            "best_camera": (("distance", "way"), np.repeat(best[:, None], 3, axis=1).astype(object)),
            "reading_says": ("reading", np.array(list(READINGS.values()), dtype=object)),
            "decision_ratio": (
                ("reading", "place", "way"),
                ratio,
                {"numerator": "plenoptic", "denominator": "stereo"},
            ),
            "decision_winner": (("reading", "place", "way"), winner),
            "decision_flips": (("reading", "place", "way"), winner != winner[:1]),
            "crossover_distance": (("reading", "crossing"), np.array([[0.391], [0.52], [0.391], [np.nan]])),
            "solved_value": ("question", np.array([0.0119, 2e-6])),
            "solved_unit": ("question", np.array(["rad", "m"], dtype=object)),
            "solved_says": (
                "question",
                np.array(
                    ["yaw at which stereo equals the R5 at 0.5 m", "error of z that gives 1 % at 0.3 m"], dtype=object
                ),
            ),
        },
        coords={
            "distance": DISTANCE,
            "way": WAYS,
            "reading": list(READINGS),
            "place": PLACES,
            "question": ["yaw", "z"],
        },
    )


def _registers(keys: list[str]) -> dict[str, xr.Dataset]:
    def register(dim: str, count: int, **columns: list[object]) -> xr.Dataset:
        values = {name: (dim, np.array(column, dtype=object)) for name, column in columns.items()}
        return xr.Dataset(values, coords={dim: np.arange(count)})

    return {
        "/assumptions": register(
            "assumption",
            2,
            path=[f"cameras.{keys[0]}.microlenses.gap", "cameras.stereo-30mm.calibration.yaw"],
            value=["0.568 mm", "0.2°"],
            basis=["assumed", "paper"],
            note=["f-number matching", ""],
        ),
        "/contradictions": register(
            "contradiction",
            1,
            camera=["stereo-30mm"],
            what=["field of view"],
            stated=["65.24°"],
            implied=["19.06°"],
            used=["focal length as printed"],
        ),
        "/claims": _claims(),
        "/requirements": register(
            "requirement",
            2,
            says=["below 2 % from 0.1 m to 0.4 m", "any camera at 1 m"],
            met=[False, True],
            margin_percent=[-35.0, float("inf")],
            margin_sigma=[-2.1, float("nan")],
            reason=["no camera before 0.15 m", ""],
        ),
        "/criteria": xr.Dataset(
            {"value": (("camera", "criterion"), np.array([["0", "1"], ["0", "2"], ["0", "2"]], dtype=object))},
            coords={"camera": keys, "criterion": ["moving_parts", "images_per_scene"]},
        ),
    }


def _claims() -> xr.Dataset:
    def words(*values: str) -> tuple[str, np.ndarray]:
        return "claim", np.array(values, dtype=object)

    return xr.Dataset(
        {
            "value": (("claim", "reading"), np.array([[0.391, 0.391, 0.391, 0.391], [6.8, np.nan, 36.0, 6.8]])),
            "met": (("claim", "reading"), np.array([[False] * 4, [True, False, False, True]])),
            "unit": words("m", "m"),
            "says": words("stereo from about 0.5 m", "range limited to 7 m"),
            "source": words("section 6", "section 6"),
            "expected": words("0.5 m within 25 %", "7 m within 10 %"),
            "wording": words("≈ 0.5 m", "7 m"),
            "verdict": words("not met", "cannot be decided from the paper"),
            "reason": words("overlap of 80 % begins at 0.391 m", "follows from this set of assumptions only"),
        },
        coords={"claim": ["C1", "C4"], "reading": list(READINGS)},
    )
