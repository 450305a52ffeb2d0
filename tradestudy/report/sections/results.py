"""Results: where each camera is usable, which error source favours which, and what decides the uncertainty."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.figures.drawing import Drawing
from tradestudy.report.document import Block, Bullets, Column, Heading, Paragraph, Spans, Table, Text, pictures_of, say
from tradestudy.report.words import part_words, share
from tradestudy.results.views.decision import Flips, answer_title, flips, readings_in_words
from tradestudy.results.views.depth import (
    at_the_bound,
    declared_matchers,
    is_swept,
    least_broken,
    lower_bound_words,
    nominal,
    uniform_shares,
)
from tradestudy.results.views.designs import favoured_words
from tradestudy.results.views.groups import camera_titles, group, has, titles_in
from tradestudy.units import significant
from tradestudy.wording import counted, distance, few, in_words, listed, with_article, within

_NOWHERE = "nowhere"
_MISSING = (
    " For a camera that is usable nowhere, the table names the limits that it misses where it misses the fewest, and "
    "the nearest such distance."
)


def describe_results(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Write the results, one part per question; a part whose group is missing is left out."""
    if has(tree, "depth"):
        yield Heading(text="Results", anchor="results")
        yield from _usable_range(tree)
        yield from pictures_of(drawings, "whole_range", "deciding_cameras")
        yield Heading(text="What decides the uncertainty", anchor="parts", level=2)
        yield from _uniform(tree)
        yield from pictures_of(drawings, "variance_shares")
        yield from _pictured(drawings, "Off the axis", "off-axis", "off_axis")
        yield from _over_the_picture(tree, drawings)
        if is_swept(tree):
            yield Heading(text="Swept designs", anchor="sweeps", level=2)
            yield Bullets(tuple(_of_designs(tree)))
            yield from pictures_of(drawings, "sweep_map", "pareto")


def _of_designs(tree: xr.DataTree) -> Iterator[Spans]:
    """Which cameras the designs of a sweep favour."""
    if favoured := "; ".join(favoured_words(tree)):
        yield say("Best {favoured}.", favoured=favoured)


def _pictured(drawings: Mapping[str, Drawing], title: str, anchor: str, *names: str) -> Iterator[Block]:
    """Show figures under a heading of their own; nothing if the run has none of them."""
    if pictures := tuple(pictures_of(drawings, *names)):
        yield Heading(text=title, anchor=anchor, level=2)
        yield from pictures


def _uniform(tree: xr.DataTree) -> Iterator[Paragraph]:
    """Name the cameras of whose variance one part makes nearly all, which a figure would show as a blank panel."""
    titles, by_part = titles_in(tree, "depth"), dict[str, list[str]]()
    for camera, part in uniform_shares(tree).items():
        by_part.setdefault(part, []).append(titles[camera])
    for part, names in by_part.items():
        share_words = f"More than 95 % of the variance of {few(names)} at all distances"
        yield Paragraph(f"{share_words} comes from {part_words(part)}.")


def _over_the_picture(tree: xr.DataTree, drawings: Mapping[str, Drawing]) -> Iterator[Block]:
    """Show maps of depth uncertainty for each rig that has any."""
    if not has(tree, "depth_map"):
        return
    names = [f"depth-map-{key}" for key in group(tree, "depth_map")["camera"].values]
    pictures = tuple(pictures_of(drawings, *names))
    if pictures:  # the first page has one of them
        yield Heading(text="Over the picture", anchor="depth-map", level=2)
    for picture in pictures:
        yield Paragraph(picture.alt)
        yield picture


def _usable_range(tree: xr.DataTree) -> Iterator[Block]:
    depth = nominal(tree)
    rows: list[tuple[Text, ...]] = []
    for key, title in titles_in(tree, "depth").items():
        camera = depth.sel(camera=key)
        intervals = [
            (distance(near, digits), in_words(str(near_limit)), distance(far, digits), in_words(str(far_limit)))
            for (near, far, digits), near_limit, far_limit in zip(
                itertools.starmap(within, zip(camera["usable_near"].values, camera["usable_far"].values, strict=True)),
                camera["near_limit"].values,
                camera["far_limit"].values,
                strict=True,
            )
            if np.isfinite(near) and not np.isnan(far)
        ]
        rows += [(title, *interval) for interval in intervals] or [(title, _NOWHERE, _what_is_missing(camera), "", "")]
    nowhere = any(row[1] == _NOWHERE for row in rows)
    yield Heading(text="Where each camera is usable", anchor="usable-range", level=2)
    yield Table(
        name="usable-range-table",
        caption=say(
            "Usable distances, and the limit that sets each end (explained in section [](#method-usable)).{missing}",
            missing=_MISSING if nowhere else "",
        ),
        columns=(
            Column(title="Camera", weight=3),
            Column(title="From", align="right"),
            Column(title="set by", weight=2),
            Column(title="To", align="right"),
            Column(title="set by", weight=2),
        ),
        rows=tuple(rows),
    )


def _what_is_missing(camera: xr.Dataset) -> str:
    """Name the limits that fail at the distance where the fewest do, for a camera that is usable nowhere."""
    broken = camera["limit_met"].transpose("distance", "limit").values == 0
    best = least_broken(broken)
    names = camera["limit"].values[broken[best]]
    return f"{', '.join(map(in_words, names))} (at {distance(float(camera['distance'].values[best]))})"


def describe_verdicts(tree: xr.DataTree) -> Iterator[Block]:
    """Say which camera noise and calibration favour on their own, and list the verdict under other readings."""
    favoured, table = tuple(_favoured_cameras(tree)), tuple(_stability(tree))
    if table:
        yield Heading(text="Which camera each error source favours", anchor="verdicts")
        yield Bullets(favoured)
        yield from table


def _favoured_cameras(tree: xr.DataTree) -> Iterator[Spans]:
    """Say which camera matching noise and calibration errors favour, each alone, and at how many distances."""
    if not has(tree, "decision", "more_certain", "uncertainty_ratio"):
        return
    declared, titles = group(tree, "decision").isel(reading=0), {**camera_titles(tree), "": "neither"}
    for source, alone in (("noise", "Matching noise"), ("calibration", "Calibration errors")):
        names = declared["more_certain"].sel(error_source=source).values.tolist()
        each = [f"{titles[camera]} at {count}" for camera, count in Counter(names).most_common()]
        yield say(f"{alone} alone: {listed(each)} of {counted(len(names), 'declared distance')}.")


def _stability(tree: xr.DataTree) -> Iterator[Block]:
    """List the verdict on the main pair under the other readings, at each declared distance."""
    verdicts = tuple(flips(tree))
    if not verdicts:
        return
    titles, decision = camera_titles(tree), group(tree, "decision")
    says = readings_in_words(decision)
    has_other_readings = any(verdict.alternatives for verdict in verdicts)
    pair = f"{titles[decision.attrs['first']]} against {with_article(titles[decision.attrs['second']])}"
    changed = (
        ", and the other readings that change this, each with the camera that is then better"
        if has_other_readings
        else ""
    )
    yield Table(
        name="verdict-table",
        caption=f"{pair}: the better camera of those that are usable{changed}. On the right: the camera with the "
        "smaller depth uncertainty, usable or not, and the ratio of the two uncertainties.",
        columns=(
            Column(title="At", align="right"),
            Column(title="Better, where usable", weight=0 if has_other_readings else 1),
            *((Column(title="Other readings that change this", weight=1),) if has_other_readings else ()),
            Column(title="More certain", weight=0 if has_other_readings else 1),
            Column(title="By a factor of", align="right"),
        ),
        rows=tuple(
            (
                distance(verdict.place),
                answer_title(titles, verdict.winner, "neither"),
                *((_flipped(verdict, titles, says),) if has_other_readings else ()),
                answer_title(titles, verdict.more_certain, "neither" if np.isnan(verdict.ratio) else "tied"),
                _factor(verdict.ratio) + (", within the tolerance" if verdict.within_tolerance else ""),
            )
            for verdict in verdicts
        ),
    )


def _factor(ratio: float) -> str:
    """Write the factor by which the better camera is more certain, from a ratio in either direction."""
    if np.isnan(ratio):
        return "—"
    if not 0.0 < ratio < np.inf:
        return "∞"
    factor = max(ratio, 1.0 / ratio)
    written = (significant(factor, digits) for digits in range(2, 5))
    return next((words for words in written if words != "1"), "1" if factor == 1.0 else "about 1")


def _flipped(verdict: Flips, titles: Mapping[str, str], says: Mapping[str, str]) -> Text:
    return say(
        "**{count} of {all}**{names}",
        count=str(len(verdict.flipped)),
        all=str(verdict.alternatives),
        names=(": " if verdict.flipped else "")
        + "; ".join(
            f"“{says[reading]}” ({answer_title(titles, winner, 'neither')})" for reading, winner in verdict.flipped
        ),
    )


_COLUMNS: Final = {
    "no blur": "No blur",
    "no diffraction": "No diffraction",
    "light of the brightest": "Brightest light",
    "ten times the light": "Tenfold light",
}
# The causes that are removed; tenfold light is not one of them, because it helps every camera.
_CAUSES: Final = {
    "no blur": "defocus blur",
    "no diffraction": "diffraction",
    "light of the brightest": "lack of light",
}


def describe_disparity_causes(tree: xr.DataTree) -> Iterator[Block]:
    """Say what counts most in each derived disparity error, and write the table behind it."""
    if not has(tree, "disparity_causes"):
        return
    causes = group(tree, "disparity_causes")
    titles = titles_in(tree, "disparity_causes")
    yield Heading(text="What the disparity error is made of", anchor="disparity-causes")
    yield Paragraph(
        say(
            "A disparity error derived from the simulated picture is the smallest that any matcher can reach. To find "
            "its causes, the program recomputes it with one change at a time: without defocus blur, without "
            "diffraction, or with the light of the brightest of these cameras. The computation of depth leaves out "
            "effects that change its uncertainty by less than the tolerance, so the disparity errors that it uses "
            "(“Sub-pixel RMS” in the data sheets) can differ from these."
        )
    )
    yield from _of_matchers(tree)
    yield _table(causes, titles)


def _of_matchers(tree: xr.DataTree) -> Iterator[Block]:
    """Say which bounds leave out a real matcher, and what declared matchers add."""
    head, bounds = lower_bound_words(at_the_bound(tree))
    if bounds:
        yield Paragraph(
            say(
                "{head}: {bounds}. To include what a real matcher adds, declare `scene.picture.matcher`, or "
                "`depth.matcher` of a camera.",
                head=head,
                bounds=bounds[0],
            )
        )
    declared = declared_matchers(tree)
    if not declared:
        return
    alike = {words: [title for title, matcher in declared.items() if matcher == words] for words in declared.values()}
    added = " ".join(f"The declared matcher of {listed(names)} adds {words}." for words, names in alike.items())
    yield Paragraph(
        say(
            "{added} A floor and the rms of pixel locking add in quadrature; pixel locking does not average out within "
            "one distance. False matches count as failed measurements.",
            added=added,
        )
    )


def _changed(camera: xr.Dataset) -> dict[str, float]:
    """The disparity error without each cause that can be removed."""
    changed = {change: float(camera["disparity_error_px_changed"].sel(change=change)) for change in _CAUSES}
    return {change: value for change, value in changed.items() if not np.isnan(value)}


def _largest(camera: xr.Dataset) -> str | None:
    """The cause without which the error is smallest; None if no cause counts."""
    error = float(camera["disparity_error_px"])
    factors = {change: _error_ratio(error, value) for change, value in _changed(camera).items()}
    cause = max(factors, key=lambda cause: factors[cause], default="")
    return cause if cause and factors[cause] > 1.0 else None


def _error_ratio(error: float, changed: float) -> float:
    """How many times smaller an error becomes: 1 if three digits show no change, infinite or 0 if one has no bound."""
    if error == changed:
        return 1.0
    if np.isinf(error) or changed == 0.0:
        return np.inf
    factor = error / changed
    distinct = factor == 0.0 or "1" not in (significant(factor), significant(1.0 / factor))
    return factor if distinct else 1.0


def _table(causes: xr.Dataset, titles: Mapping[str, str]) -> Table:
    changes = [
        change
        for change in _COLUMNS
        if not np.isnan(causes["disparity_error_px_changed"].sel(change=change).values).all()
    ]
    rows: list[tuple[Text, ...]] = []
    for place in causes["distance"].values:
        at_distance = causes.sel(distance=place)
        rows.append((f"At {distance(float(place))}",))
        rows += [_row(at_distance.sel(camera=key), title, changes) for key, title in titles.items()]
    compared, real = "light of the brightest" in changes, "matched_error_px" in causes
    windows = "matched_window_px" in causes  # results of earlier versions lack it
    return Table(
        name="disparity-causes-table",
        caption=(
            "Disparity error in pixels with every effect, by the declared matcher, its bound, and that"
            if real
            else "Derived disparity error in pixels with every effect, and"
        )
        + " with one cause removed; in brackets, how many times smaller that makes it. Bold: the cause that counts "
        "most.",
        columns=(
            Column(title="Camera", weight=6),
            Column(title="Electrons", align="right"),
            *((Column(title="Window", align="right"),) if windows else ()),
            *(
                Column(title=title, align="right", weight=5)
                for title in (("By matcher", "Bound") if real else ("Disparity error",))
            ),
            *(Column(title=_COLUMNS[change], align="right", weight=8) for change in changes),
        ),
        rows=tuple(rows),
        notes=(
            "Electrons: mean per pixel. "
            + (
                "Window: side of the matching window in pixels; the declared window, or the part of it that both "
                "pictures share. "
                if windows
                else ""
            )
            + "A factor below 1 means that the error would be larger, since blur also removes texture that is too "
            "fine for the pixels. "
            * any("(0" in str(cell) for row in rows for cell in row)
            + "The causes interact: removing two of them need not multiply their factors. Tenfold light (saturation "
            "ignored) divides the error by about 3.2 where shot noise limits it, by more where the "
            "sensor adds noise or noise hides the texture, and by less where aliased texture acts as noise. Where a "
            "camera is not usable, a matcher may miss these bounds."
            + (" Brightest light: that of the unsaturated camera with the most electrons." if compared else "")
            + _numerical_error(causes, titles),
        ),
    )


def _row(camera: xr.Dataset, title: str, changes: Sequence[str]) -> tuple[Text, ...]:
    error = float(camera["disparity_error_px"])
    matched = [significant(float(camera["matched_error_px"]))] if "matched_error_px" in camera else []
    window = [significant(float(camera["matched_window_px"]))] if "matched_window_px" in camera else []
    if np.isnan(error):
        return (title, "—", *("—" for _ in window), *("—" for _ in matched), "no picture", *("—" for _ in changes))
    most = _largest(camera)
    written = {change: _cell(camera, error, change) for change in changes}
    cells = [say("**{cell}**", cell=cell) if change == most else cell for change, cell in written.items()]
    return (title, significant(float(camera["electrons"])), *window, *matched, significant(error), *cells)


def _cell(camera: xr.Dataset, error: float, change: str) -> str:
    value = float(camera["disparity_error_px_changed"].sel(change=change))
    if np.isnan(value):
        return "itself" if str(camera["brightest_camera"].item()) == str(camera["camera"].item()) else "—"
    return f"{significant(value)}\N{NO-BREAK SPACE}({significant(_error_ratio(error, value))}×)"


def _numerical_error(causes: xr.Dataset, titles: Mapping[str, str]) -> str:
    """Say the largest estimated numerical error, with its camera and distance."""
    error, changed = (
        (causes[f"{variable}_error"] / causes[variable].where(causes[variable] > 0.0))
        .where(lambda value: np.isfinite(value))
        .fillna(0.0)
        for variable in ("disparity_error_px", "disparity_error_px_changed")
    )
    largest = error.clip(min=changed.max("change"))
    if not largest.any():
        return ""
    camera, place = largest.stack(place=("camera", "distance")).idxmax().item()
    worst = f"{share(float(largest.max()))} ({titles[camera]} at {distance(place)})"
    return f" Estimated numerical error: at most {worst}."
