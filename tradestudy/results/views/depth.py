"""Views of depth: by camera, in ranges, off the axis, from error sources, biased, or measured in pictures."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import xarray as xr

from tradestudy.results import distances_without_decision, judged_uncertainty
from tradestudy.results.views.groups import FloatArray, camera_titles, group, has, ranges_of, titles_in
from tradestudy.units import FRACTION, LENGTH, pretty, significant
from tradestudy.wording import distance, few, with_article

_SEEN_TWICE: Final = ("overlap", "availability")  # limits on the share of points
_MEASURED: Final = (
    "depth_discrimination",
    "depth_uncertainty",
    "depth_uncertainty_by_error_source",
    "depth_error_radius",
    "depth_error_radius_by_error_source",
    "depth_quantile",
    "variance_share",
    "equivalent_baseline",
    "failed_fraction",
)


def swept(depth: xr.Dataset) -> tuple[str, ...]:
    """The names of the swept parameters: the dimensions of ``/depth`` besides camera and distance."""
    return tuple(str(d) for d in depth["depth_uncertainty"].dims if d not in ("camera", "distance"))


def is_swept(tree: xr.DataTree) -> bool:
    """Whether the study varies values, so that its answers are those of several designs."""
    return has(tree, "depth") and bool(swept(group(tree, "depth")))


def nominal(tree: xr.DataTree) -> xr.Dataset:
    """``/depth`` of one design: every swept parameter at its declared value, or at its first if that is not swept."""
    depth = group(tree, "depth")
    return depth.isel({dim: declared_place(depth[dim]) or 0 for dim in swept(depth)})


def nominal_is_declared(tree: xr.DataTree) -> bool:
    """Whether `nominal` returns the declared design, which ``/decision`` describes."""
    depth = group(tree, "depth")
    return all(declared_place(depth[dim]) is not None for dim in swept(depth))


def declared_place(coordinate: xr.DataArray) -> int | None:
    """Index of the declared value (an attribute of the coordinate) among the swept values; None if it is not one."""
    same = np.flatnonzero(coordinate.values == coordinate.attrs.get("declared"))
    return int(same[0]) if same.size else None


def of_camera(depth: xr.Dataset, variable: str, camera: str, **where: str) -> FloatArray:
    """One variable of one camera over distance."""
    variables = depth.variables  # a DataArray and its indexes would take ten times as long
    at = {dim: list(variables[dim].values).index(label) for dim, label in {"camera": camera, **where}.items()}
    return np.asarray(variables[variable].isel(at).values, dtype=np.float64)


def where_measured(depth: xr.Dataset) -> xr.Dataset:
    """``/depth`` with NaN where a camera sees no point twice: it measures nothing, although its formula has a value."""
    if "limit_value" not in depth:
        return depth
    shares = depth["limit_value"].sel(limit=[limit for limit in _SEEN_TWICE if limit in depth["limit"].values])
    seen = ~(shares <= 0.0).any("limit")
    # Without indexes, which are the same: comparing them takes most of the time of this.
    return depth.assign(
        {
            variable: depth[variable].variable.where(seen.variable)  # type: ignore[no-untyped-call]  # xarray leaves it out
            for variable in _MEASURED
            if variable in depth
        }
    )


_UNIFORM: Final = 0.95  # of the variance


def uniform_shares(tree: xr.DataTree) -> dict[str, str]:
    """The cameras, by key, of whose variance one part makes more than 95 % at all distances and in all designs."""
    depth = where_measured(group(tree, "depth"))
    least = depth["variance_share"].min([dim for dim in depth["variance_share"].dims if dim not in ("camera", "part")])
    return {
        str(camera): str(part)
        for camera, shares in zip(depth["camera"].values, least.transpose("camera", "part").values, strict=True)
        for part, share in zip(depth["part"].values, shares, strict=True)
        if share > _UNIFORM
    }


def where_usable(depth: xr.Dataset, camera: str) -> tuple[tuple[float, float], ...]:
    """The usable ranges of a camera, as (near, far) in metres; empty where it is usable nowhere."""
    return ranges_of(of_camera(depth, "usable_near", camera), of_camera(depth, "usable_far", camera))


def field_words(field: float, corner: str = "") -> str:
    """A field position in words: 0 is the axis, 1 the corner of the sensor; towards any corner if none is named."""
    return (
        f"{significant(100.0 * field)} % of the way to the {f'{corner} ' * bool(corner)}corner"
        if field
        else "on the axis"
    )


def worst_corner(off: xr.Dataset) -> xr.DataArray:
    """The largest depth uncertainty in ``/depth_field`` towards any corner that the camera sees."""
    return off["depth_uncertainty"].max("corner")


def table_distances(tree: xr.DataTree) -> FloatArray:
    """The distances [m] that tables list: the declared ones or, without a decision, a few that span the range."""
    if has(tree, "decision") and "place" in tree["decision"].coords:
        return np.asarray(group(tree, "decision")["place"].values, dtype=np.float64)
    return distances_without_decision(np.asarray(group(tree, "depth")["distance"].values, dtype=np.float64))


def table_depth(tree: xr.DataTree) -> xr.Dataset:
    """Depth at the declared distances or, where none are declared, on the study's grid; see `where_measured`."""
    return where_measured(group(tree, "depth_at_places") if has(tree, "depth_at_places") else nominal(tree))


def by_first_criterion(tree: xr.DataTree) -> xr.Dataset:
    """``/depth_of_field`` by the first blur criterion, which decides the answer."""
    return group(tree, "depth_of_field").isel(sharp=0)


def sharp_ranges(camera: xr.Dataset, kind: str) -> tuple[tuple[float, float], ...]:
    """Ranges of distance [m] of one camera by one criterion, as (near, far): ``sharp``, ``slice`` or ``gap``."""
    return ranges_of(camera[f"{kind}_near"].values, camera[f"{kind}_far"].values)


@dataclass(frozen=True, kw_only=True)
class SharpCamera:
    """What one camera keeps sharp of the scene by the first blur criterion, and at what expense.

    Parameters
    ----------
    share
        Fraction of the scene's range of distance that is sharp.
    stretches
        Sharp ranges of distance, as (near, far) [m].
    resolution, diffraction
        Size of the smallest detail that the camera resolves throughout the scene, and largest diffraction width [m].
    images, moving_parts
        Number of exposures; the trade criterion "moving parts", a dash if the study does not ask for it.
    """

    key: str
    title: str
    share: float
    stretches: tuple[tuple[float, float], ...]
    resolution: float
    diffraction: float
    images: int
    moving_parts: str

    @property
    def keeps_all(self) -> bool:
        """Whether the whole scene is sharp."""
        return self.share >= 1.0 - 1e-9


def sharp_cameras(tree: xr.DataTree) -> tuple[SharpCamera, ...]:
    """All cameras: first those that keep the whole scene sharp, the finest first; empty if the study does not ask."""
    if not has(tree, "depth_of_field", "scene_share"):
        return ()
    data, moving = by_first_criterion(tree), {}
    if has(tree, "criteria", "value") and "moving parts" in group(tree, "criteria")["criterion"].values:
        values = group(tree, "criteria")["value"].sel(criterion="moving parts")
        moving = dict(zip(map(str, values["camera"].values), map(str, values.values), strict=True))
    rows = (
        SharpCamera(
            key=key,
            title=title,
            share=float(camera["scene_share"]),
            stretches=sharp_ranges(camera, "sharp"),
            resolution=float(camera["scene_resolution"]),
            diffraction=float(camera["scene_diffraction"]),
            images=int(camera["images"]),
            moving_parts=moving.get(key, "—"),
        )
        for key, title in camera_titles(tree).items()
        for camera in [data.sel(camera=key)]
    )
    return tuple(sorted(rows, key=lambda row: (not row.keeps_all, -row.share, row.resolution)))


def least_broken(broken: npt.NDArray[np.bool_]) -> int:
    """Index of the distance at which a camera violates the fewest limits; ``broken`` is (distance, limit)."""
    return int(np.argmin(broken.sum(axis=1)))


def by_design(depth: xr.Dataset, variable: xr.DataArray, *dims: str) -> npt.NDArray[Any]:
    """Values of a variable over (designs, *dims), the last swept parameter varying fastest."""
    sizes = [variable.sizes[dim] for dim in dims]
    return variable.transpose(*swept(depth), *dims).values.reshape(-1, *sizes)


def largest_parts(depth: xr.Dataset) -> tuple[npt.NDArray[np.object_], FloatArray]:
    """The part with the largest share of the variance and this share, over (designs, cameras, distances).

    Where no share is known, the part is None and its share −∞.
    """
    shares = by_design(depth, depth["variance_share"], "camera", "distance", "part")
    shares = np.where(np.isnan(shares), -np.inf, shares)
    largest = depth["part"].values.astype(object)[np.argmax(shares, axis=-1)]
    largest[~np.isfinite(shares).any(axis=-1)] = None
    return np.asarray(largest), np.asarray(shares.max(axis=-1))


def largest_source(tree: xr.DataTree, camera: str, distance: float) -> str | None:
    """The error source with the largest uncertainty of its own on the axis, at a distance of ``/sensitivity`` [m]."""
    sources = group(tree, "sensitivity")["source_uncertainty"].sel(camera=camera, field=0.0, distance=distance)
    array = np.asarray(sources.values, dtype=np.float64)
    return str(sources["source"].values[int(np.nanargmax(array))]) if np.isfinite(array).any() else None


_CLEARLY_WORSE: Final = 1.1  # times the depth uncertainty on the axis


@dataclass(frozen=True, kw_only=True)
class OffAxis:
    """How a camera measures off the axis, compared with the axis, where it is usable there.

    Parameters
    ----------
    ratio, where
        Largest depth uncertainty, over that on the axis at the same distance, and the place in words; 1 and "" if the
        uncertainty grows nowhere.
    unseen
        A place where it measures no depth, in words; empty if there is none.
    """

    ratio: float
    where: str
    unseen: str


def off_axis(tree: xr.DataTree, camera: str) -> OffAxis:
    """The worst of all places off the axis that a run computed for a camera, at its field places and over its map."""
    places = [(1.0, "")]
    unseen = ""
    if has(tree, "depth_field", "depth_uncertainty") and nominal_is_declared(tree):
        depth, off = nominal(tree), group(tree, "depth_field")
        distances = np.asarray(depth["distance"].values, dtype=np.float64)
        usable = np.zeros(distances.shape, dtype=bool)
        for near, far in where_usable(depth, camera):
            usable |= (near <= distances) & (distances <= far)
        at_field = judged_uncertainty(off).sel(camera=camera).transpose("field", "corner", "distance").values
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(usable, at_field / judged_uncertainty(depth).sel(camera=camera).values, np.nan)

        def where(field: int, corner: int, place: int) -> str:
            towards = field_words(float(off["field"].values[field]), str(off["corner"].values[corner]))
            return f"{towards}, at {distance(float(distances[place]))}"

        missing = np.argwhere(usable & np.isnan(at_field))
        unseen = where(*missing[0].tolist()) if missing.size else ""
        if not np.isnan(ratio).all():
            worst = np.unravel_index(np.nanargmax(ratio), ratio.shape)
            places.append((float(ratio[worst]), where(*map(int, worst))))
    if has(tree, "depth_map", "depth_uncertainty") and camera in group(tree, "depth_map")["camera"].values:
        judged = judged_uncertainty(group(tree, "depth_map")).sel(camera=camera).transpose("distance", "down", "across")
        ratio = (judged / judged.sel(down=0.0, across=0.0, method="nearest")).values
        if not np.isnan(ratio).all():
            place, down, across = map(int, np.unravel_index(np.nanargmax(ratio), ratio.shape))
            side = "upper" if 2 * down < ratio.shape[1] else "lower"
            side += " left" if 2 * across < ratio.shape[2] else " right"
            there_words = f"at the edge of the picture, {side}, at {distance(float(judged['distance'].values[place]))}"
            places.append((float(ratio[place, down, across]), there_words))
    most, words = max(places, key=lambda entry: entry[0])
    return OffAxis(ratio=most, where=words, unseen=unseen)


def off_axis_words(tree: xr.DataTree) -> list[str]:
    """How much less certain depth is off the axis, where it is most so, and where there is none.

    The worst camera is first; cameras that it hardly affects are left out.
    """
    if not has(tree, "depth"):
        return []
    clauses = []
    each = [(title, off_axis(tree, camera)) for camera, title in titles_in(tree, "depth").items()]
    for title, worst in sorted(each, key=lambda entry: (not entry[1].unseen, -entry[1].ratio)):
        if worst.unseen:
            clauses.append(f"{with_article(title)} measures no depth ({worst.unseen})")
        if worst.ratio > _CLEARLY_WORSE:
            times = f"up to {significant(worst.ratio, 3)} times as uncertain" if worst.ratio < math.inf else "unbounded"
            clauses.append(f"depth by {with_article(title)} is {times} ({worst.where})")
    return clauses


_REPORTED: Final = 0.1  # of the depth uncertainty


def offset_words(tree: xr.DataTree) -> list[str]:
    """The cameras whose median is off by more than a tenth of the depth uncertainty where they are usable.

    Each with the distance at which the offset is the largest share of the depth uncertainty; the worst first.
    """
    if not has(tree, "depth", "depth_quantile"):
        return []
    depth, titles, offsets = where_measured(nominal(tree)), camera_titles(tree), []
    median = depth["depth_quantile"].sel(error_source="both").sel(quantile=0.5, method="nearest")
    for camera in map(str, depth["camera"].values):
        places = np.asarray(depth["distance"].values, dtype=np.float64)
        offset = np.asarray(median.sel(camera=camera).values, dtype=np.float64) - places
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = np.abs(offset) / of_camera(depth, "depth_uncertainty", camera)
        shares = np.where(of_camera(depth, "usable", camera) > 0.0, np.nan_to_num(shares, nan=0.0, posinf=0.0), 0.0)
        worst = int(np.argmax(shares))
        if shares[worst] <= _REPORTED:
            continue
        side = "far" if offset[worst] > 0.0 else "near"
        off = pretty(abs(float(offset[worst])), LENGTH, digits=2)
        of_it = pretty(float(shares[worst]), FRACTION, digits=2)
        words = (
            f"half of all measurements by {with_article(titles[camera])} are at least {off} too {side} at "
            f"{distance(float(places[worst]))}, {of_it} of the depth uncertainty there"
        )
        offsets.append((float(shares[worst]), words))
    return [words for _, words in sorted(offsets, key=lambda entry: -entry[0])]


_CAUSES: Final = "disparity_causes"


def declared_matchers(tree: xr.DataTree) -> dict[str, str]:
    """The declared matcher in words, by title, of each camera whose disparity error is derived."""
    if not has(tree, _CAUSES, "matcher"):
        return {}
    words = dict(zip(group(tree, _CAUSES)["camera"].values, group(tree, _CAUSES)["matcher"].values, strict=True))
    return {title: str(words[key]) for key, title in titles_in(tree, _CAUSES).items() if words[key]}


def false_matches_declared(tree: xr.DataTree) -> bool:
    """Whether failed measurements contain false matches."""
    return has(tree, _CAUSES, "false_matches") and bool((group(tree, _CAUSES)["false_matches"] > 0.0).any())


def at_the_bound(tree: xr.DataTree) -> tuple[str, ...]:
    """Titles of the cameras whose derived disparity error is the bound, because they declare no matcher."""
    if not has(tree, _CAUSES):
        return ()
    real = declared_matchers(tree)
    return tuple(title for title in titles_in(tree, _CAUSES).values() if title not in real)


def lower_bound_words(titles: Sequence[str]) -> tuple[str, list[str]]:
    """The caveat on errors at the bound of matching: its head, and the cameras; none if no camera has such errors."""
    return "Lower bound, as no matcher is declared", [f"the disparity error of {few(titles)}"] if titles else []


_NUMBERS: Final = ("spread", "spread_error", "bias", "bias_error", "predicted", "predicted_bias", "filled")


def measured_numbers(tree: xr.DataTree) -> list[dict[str, Any]]:
    """The depth that each camera measured, of the scene and of each plane; NaN where it measured nothing."""
    rows: list[dict[str, Any]] = []
    for group_name, camera in (("pictures", "mapped_camera"), ("depth_loop", "camera")):
        if not has(tree, group_name, "depth_spread"):
            continue
        titles = camera_titles(tree)
        table = group(tree, group_name)[[f"depth_{number}" for number in _NUMBERS]].to_dataframe().reset_index()
        for row in table.rename(columns=lambda column: str(column).removeprefix("depth_")).to_dict("records"):
            values = {str(key): value for key, value in row.items() if key != camera}
            rows.append(
                {"camera": titles[row[camera]], "of": "scene" if group_name == "pictures" else "plane", **values}
            )
    return rows


def scene_by_error(tree: xr.DataTree) -> list[dict[str, Any]]:
    """`measured_numbers` of the scene where depth was measured, by the root sum of squares of spread and bias."""
    rows = [row for row in measured_numbers(tree) if row["of"] == "scene" and np.isfinite(row["spread"])]
    errors = [row | {"error": math.hypot(row["spread"], row["bias"])} for row in rows]
    return sorted(errors, key=lambda row: row["error"])


def spreads_over_predicted(data: xr.Dataset, camera: str) -> FloatArray:
    """The measured spread relative to the predicted one, of every plane of ``/depth_loop`` that a camera measured."""
    over = np.ravel(data["depth_relative_spread"].sel(camera=camera).values)
    return np.asarray(over[np.isfinite(over)], dtype=np.float64)
