"""/datasheet: every camera in the terms of depth-camera data sheets, at one to five distances."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.answers.decision import is_usable
from tradestudy.cameras.depth_camera import DepthCamera, UsableCriteria, disparity_error_at
from tradestudy.depth.evaluation import depth_uncertainty, distribution, imaged, judged_at
from tradestudy.depth.usable import usable_intervals
from tradestudy.imaging.picture import PictureDisparityError
from tradestudy.optics.arrays import FloatArray
from tradestudy.results import dataset
from tradestudy.study.prepared import PreparedStudy

_MOST: Final = 5


def datasheet_group(study: PreparedStudy) -> xr.Dataset:
    """/datasheet over (camera, distance)."""
    case, places = study.case, _places(study)
    middle = float(places[places.size // 2])
    columns: dict[str, list[FloatArray]] = {}
    single: dict[str, list[float]] = {}
    for camera_name, camera in case.cameras.items():
        usable, shared = is_usable(case, camera_name, places), _seen_twice(camera, places)
        seen, measured = shared > 0.0, 1.0 - distribution(camera, imaged(camera, places), "both").failed_fraction
        left, right, top, bottom = np.transpose([camera.edge_angles(float(place)) for place in places])
        ranges = usable_intervals(camera, case.criteria, case.distance)
        view = camera.edge_angles(middle)
        for key, values in {
            "z_accuracy": np.where(seen, judged_at(camera, places, "calibration"), np.nan),
            "temporal_noise": np.where(seen, depth_uncertainty(_repeating(camera), places, "noise"), np.nan),
            "subpixel_rms": np.where(camera.images(places) & seen, disparity_error_at(camera, places), np.nan),
            "plane_fit_rms": np.where(seen, depth_uncertainty(camera, places, "noise"), np.nan),
            "fill_rate": np.where(usable, np.nan_to_num(shared * measured), 0.0),
            "field_width": camera.from_pupil(places) * (_slope(left) + _slope(right)),
            "field_height": camera.from_pupil(places) * (_slope(top) + _slope(bottom)),
            "usable": usable.astype(np.float64),
        }.items():
            columns.setdefault(key, []).append(values)
        for key, value in {
            "horizontal_field_of_view": view[0] + view[1],
            "vertical_field_of_view": view[2] + view[3],
            "near_limit": ranges[0].near if ranges else math.nan,
            "far_limit": ranges[-1].far if ranges else math.nan,
        }.items():
            single.setdefault(key, []).append(value)
    return dataset("datasheet", {**columns, **single}, {"camera": list(case.cameras), "sheet_distance": places})


def _slope(angle: FloatArray) -> FloatArray:
    """Tangent of the angle of an edge; infinite where the view has no edge in the plane, from 90° on."""
    return np.where(angle < math.pi / 2.0, np.tan(angle), np.inf)


def _repeating(camera: DepthCamera) -> DepthCamera:
    """The camera without pixel locking, which repeats in every measurement at one distance."""
    law = camera.disparity_error_px
    if not isinstance(law, PictureDisparityError):
        return camera
    return replace(camera, disparity_error_px=replace(law, matcher=replace(law.matcher, pixel_locking=0.0)))


def _seen_twice(camera: DepthCamera, distance: FloatArray) -> FloatArray:
    """Share of the picture that both views, or enough microlenses, see."""
    limits = camera.limits(distance, UsableCriteria())
    shared = np.ones(distance.shape)
    for limit in ("overlap", "availability"):
        if limit in limits:
            shared = shared * np.clip(limits[limit].value, 0.0, 1.0)
    return shared


def _places(study: PreparedStudy) -> FloatArray:
    """Distances of the decision, with others added across the scene: three to five, fewer if the scene has fewer."""
    file, distance = study.file, study.case.distance
    places = np.array(sorted(set(file.decision.at if file.decision is not None else ())))
    if places.size < 3:
        ends = np.geomspace(distance[0], distance[-1], 3) if distance.size > 1 else distance
        places = np.unique(np.concatenate([places, ends]))
    return np.asarray(places[np.unique(np.linspace(0, places.size - 1, _MOST).round().astype(int))])
