"""The answer of a study in one sentence, which opens its report, its lines on the terminal and its JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final

import numpy as np
import xarray as xr

from tradestudy.light_methods import title_within_a_sentence
from tradestudy.results.views.conclusions import (
    BestRange,
    at_least,
    best_ranges,
    lower_bounds,
    never_best,
    never_usable,
    question_words,
)
from tradestudy.results.views.decision import candidates, solved_questions
from tradestudy.results.views.depth import (
    SharpCamera,
    measured_numbers,
    off_axis,
    scene_by_error,
    sharp_cameras,
    spreads_over_predicted,
)
from tradestudy.results.views.designs import all_requirements, deciding_words, feasible_words
from tradestudy.results.views.groups import camera_titles, group, has, titles_in
from tradestudy.results.views.measured import measured_tables
from tradestudy.results.views.refocusing import refocusing_words
from tradestudy.results.views.requirement_conclusions import ANY, RequirementConclusion, requirement_conclusions
from tradestudy.results.views.trade_off import candidates_by_rank
from tradestudy.results.views.wave_optics import fresnel_numbers, hard_case_words, light_numbers, where_fresnel
from tradestudy.units import DURATION, FRACTION, LENGTH, pretty, significant
from tradestudy.wording import DECLARED_VALUE, counted, few, in_words, listed, plain_span, with_article

_MOST_STRETCHES, _CHANGES = 5, "the best camera changes"
_HARDLY: Final = 1.1  # times the depth uncertainty on the axis
_MEASURED: Final = 3  # cameras beside the best that a sentence on pictures names
_NAMED: Final = 2  # cameras that a sentence names; of more, it gives the number
_LISTED: Final = 2  # measured tables or refocusing cameras that get a sentence


def headline(tree: xr.DataTree, seconds: Mapping[str, float] = MappingProxyType({})) -> str:
    """The answer in one sentence, with a full stop; empty where the results hold no answer.

    ``seconds`` of the run's steps give the pictures of a light spot their computing times.
    """
    return next(iter(answers(tree, seconds)), "")


def answers(tree: xr.DataTree, seconds: Mapping[str, float] = MappingProxyType({})) -> list[str]:
    """The headline, and a sentence on everything else that a study of several subjects answers, with full stops."""
    requirements = requirement_conclusions(tree)
    clauses = [_of_sharpness(tree), feasible_words(tree), _of_light(tree, seconds)]
    clauses += [way(tree) for way in (_of_fresnel, hard_case_words, _of_scene, _of_planes)]
    measured, has_requirements = [table.finding() for table in measured_tables(tree)[:_LISTED]], bool(requirements)
    clauses += [] if has_requirements else measured
    if not any(clauses):
        words = _of_one_camera_asked(tree, requirements) or _of_cameras(tree, requirements)
        clauses = [words or _of_requirements(requirements) or next(_questions(tree), "")]
    clauses += [deciding_words(tree), *(measured if has_requirements else [])]
    clauses += list(refocusing_words(tree))[:_LISTED]
    plain = (words.replace("\N{NO-BREAK SPACE}", " ") for words in clauses if words)
    return [f"{words[0].upper()}{words[1:]}." for words in plain]


def _of_light(tree: xr.DataTree, seconds: Mapping[str, float]) -> str:
    """How far pictures of a light spot by simpler methods differ from the most complete one, and how long each took."""
    pictures = light_numbers(tree)
    others = [picture for picture in pictures if picture["method"] != picture["reference"]]
    if not others:
        words = "the light spot is computed by {}, to {}".format
        return "".join(
            words(title_within_a_sentence(picture["method"]), pretty(picture["error"], FRACTION, digits=2))
            for picture in pictures
        )
    took = {
        method: f"{title_within_a_sentence(method)}{f', {pretty(time, DURATION, digits=2)}' if time else ''}"
        for method in (picture["method"] for picture in pictures)
        for time in [seconds.get(f"image: {method}")]
    }
    each = [f"{pretty(picture['difference'], FRACTION, digits=2)} ({took[picture['method']]})" for picture in others]
    return f"pictures differ from {took[others[0]['reference']]}, by {listed(each)}"


def _of_fresnel(tree: xr.DataTree) -> str:
    """From which f-number on Fresnel's approximation suffices behind each lens."""
    limits = fresnel_numbers(tree)
    if not limits:
        return ""
    by_phase: dict[str, dict[str, list[str]]] = {}
    for limit in limits:
        of_phase = by_phase.setdefault(limit["lens_phase"], {})
        of_phase.setdefault(where_fresnel(limit["f_number"]), []).append(limit["element"].lower())
    phases: dict[str, list[str]] = {}
    for phase, places in by_phase.items():
        each_place = [where + f" ({listed(elements)})" * (len(places) > 1) for where, elements in places.items()]
        phases.setdefault(listed(each_place), []).append(phase)
    each = "; ".join(f"{where} with a {listed(names, 'or')} phase" for where, names in phases.items())
    return f"on the axis, Fresnel suffices to {pretty(limits[0]['limit'], FRACTION)} {each}"


def _of_scene(tree: xr.DataTree) -> str:
    """Which camera measured the rendered scene best, and how, and which measured nothing."""
    rows = scene_by_error(tree)[: _MEASURED + 1]
    each = [(with_article(row["camera"]), f"to {pretty(row['error'], LENGTH, digits=2)}") for row in rows]
    best = " best," * (len(each) > 1)
    clauses = [f"{who} measures the scene{best} {to} by spread and bias together" for who, to in each[:1]]
    clauses += [listed([f"{who} {to}" for who, to in each[1:]])] * (len(each) > 1)
    blind = [row["camera"] for row in measured_numbers(tree) if row["of"] == "scene" and np.isnan(row["spread"])]
    return "; ".join([*clauses, *_blind_words(blind)])


def _of_planes(tree: xr.DataTree) -> str:
    """How far the spreads that cameras measured in pictures of planes deviate from predictions."""
    if not has(tree, "depth_loop", "depth_spread"):
        return ""
    data, titles = group(tree, "depth_loop"), titles_in(tree, "depth_loop")
    spreads = {title: spreads_over_predicted(data, key) for key, title in titles.items()}
    measuring = [title for title, over in spreads.items() if over.size]
    clauses = []
    if measuring:
        every = np.concatenate(list(spreads.values()))
        low, high = (significant(float(end), 2) for end in (every.min(), every.max()))
        measure = "measures" if len(measuring) == 1 else "measure"
        who = few(list(map(with_article, measuring)))
        clauses = [f"{who} {measure} planes with {low} to {high} times the predicted spread"]
    return "; ".join([*clauses, *_blind_words([title for title in spreads if title not in measuring])])


def _blind_words(titles: Sequence[str]) -> Iterator[str]:
    if titles:
        yield f"{few(list(map(with_article, titles)))} measured nothing in rendered pictures"


def _of_sharpness(tree: xr.DataTree) -> str:
    """Which cameras keep the scene sharp: with the fewest exposures and moving parts, and with the finest detail."""
    cameras = sharp_cameras(tree)
    if not cameras:
        return ""
    attrs = group(tree, "depth_of_field").attrs
    scene = plain_span(float(attrs["scene_near"]), float(attrs["scene_far"]))
    keep = [camera for camera in cameras if camera.keeps_all]
    if not keep:
        share = pretty(math.floor(cameras[0].share * 100.0) / 100.0, FRACTION, digits=2)
        return f"no camera keeps {scene} sharp; {with_article(cameras[0].title)} keeps {share} of it"
    finest, simplest = keep[0], min(keep, key=lambda camera: (camera.images, camera.moving_parts, camera.resolution))
    alike = [with_article(camera.title) for camera in keep if _expense(camera) == _expense(simplest)]
    which = [f"{few(alike, _NAMED, 'or')} ({_expense(simplest)})"]
    if finest.title != simplest.title:
        which.append(f"or, finer, {with_article(finest.title)} ({_expense(finest)})")
    return f"to keep {scene} sharp, take {'; '.join(which)}"


def _expense(camera: SharpCamera) -> str:
    parts = "" if camera.moving_parts == "—" else f", {counted(int(camera.moving_parts), 'moving part')}"
    return f"{pretty(camera.resolution, LENGTH)}, {counted(camera.images, 'exposure')}{parts}"


def _of_one_camera_asked(tree: xr.DataTree, requirements: Sequence[RequirementConclusion]) -> str:
    """The first question of a study that has one camera, no requirement, and questions."""
    is_asked = not requirements and has(tree, "depth") and group(tree, "depth").sizes["camera"] == 1
    return next(_questions(tree), "") if is_asked else ""


def _questions(tree: xr.DataTree) -> Iterator[str]:
    for says, answer in solved_questions(tree):
        value, _, beside = answer.partition(DECLARED_VALUE)
        declared = f" (declared: {beside.partition(';')[0]})" if beside else ""
        yield f"{question_words(says)} {value.partition(';')[0]}{declared}"


def _of_cameras(tree: xr.DataTree, requirements: Sequence[RequirementConclusion]) -> str:
    """Which camera to take, by the requirements if they are met, and otherwise by its distance."""
    must = [verdict for verdict in requirements if verdict.priority == "must"] or list(requirements)
    deciding = {verdict.camera for verdict in must if verdict.met}
    ranges = best_ranges(tree)
    if must and all(verdict.met for verdict in must) and len(deciding) == 1 and len(camera_titles(tree)) > 1:
        other, why = _trade_off_words(tree, must[0].camera), f": {_requirement_words(must)}"
        # The lead counts only if no other camera is the best at any distance.
        lead = _lead_words(tree) if {title for stretch in ranges for title in stretch.cameras} == deciding else ""
        words = f"{'for depth alone, ' * bool(other)}take {with_article(must[0].camera)}"
        return words + (lead or why) + other if other else words + why + lead
    if alone := _meets_alone(must):
        meets = "can meet" if alone in lower_bounds(tree) else "meets"
        required = f"it alone {meets} {all_requirements(len(must))}"
        return f"take {with_article(alone)}: {required}{_trade_off_words(tree, alone)}"
    words = _stretch_words(tree, ranges)
    if not words:
        return ""
    return words + _missed_words(must)


def _meets_alone(must: Sequence[RequirementConclusion]) -> str:
    """The only camera that meets several requirements on any camera; empty where none does or another one may."""
    if len(must) < 2 or any(verdict.of != ANY for verdict in must):
        return ""
    met = [{verdict.camera: verdict.met} | {other.camera: other.met for other in verdict.others} for verdict in must]
    possible = set.intersection(
        *({camera for camera in by_camera if by_camera[camera] is not False} for by_camera in met)
    )
    alone = possible.pop() if len(possible) == 1 else ""
    return alone if all(by_camera.get(alone) for by_camera in met) else ""


def _missed_words(must: Sequence[RequirementConclusion]) -> str:
    """Which requirements, or how many, are not met."""
    missed = [verdict for verdict in must if verdict.met is not True]
    if not missed:
        return ""
    if len(missed) == 1:
        return f"; “{missed[0].says}” {'is not met' if missed[0].met is False else 'cannot be decided'}"
    if len(missed) == len(must):
        return f"; {'neither requirement' if len(missed) == 2 else f'none of the {len(must)} requirements'} is met"
    return f"; {len(missed)} of {len(must)} requirements are not met"


def _of_requirements(requirements: Sequence[RequirementConclusion]) -> str:
    """The verdicts where no camera measures depth."""
    if not requirements:
        return ""
    met = [verdict for verdict in requirements if verdict.met]
    if len(met) == len(requirements):
        return f"{with_article(met[0].camera)}: {_requirement_words(met)}"
    return f"{len(met)} of {counted(len(requirements), 'requirement')} {'is' if len(met) == 1 else 'are'} met"


def _requirement_words(met: Sequence[RequirementConclusion]) -> str:
    """What a camera meets, and its value in the tightest case; it can meet what matching at its bound would meet."""
    tightest = min(met, key=lambda verdict: verdict.margin)
    alone = not any(other.met for other in tightest.others)
    which = f"“{tightest.says}”" if len(met) == 1 else all_requirements(len(met))
    only = "it alone" if alone and len(met) == 1 and tightest.others else "it"
    meets = "can meet" if any(verdict.at_lower_bound for verdict in met) else "meets"
    best = " best" if len(met) == 1 and not alone else ""
    return f"{only} {meets} {which}{best} ({tightest.reason})"


def _lead_words(tree: xr.DataTree) -> str:
    """By how much the best camera leads the usable cameras that are best nowhere, if there are any."""
    factors = [factor for _, factor in never_best(tree)]
    if not factors or (least := at_least(min(factors))) == "1":
        return ""
    others = len(candidates(tree) or group(tree, "depth")["camera"]) - 1
    usable = "usable " if len(factors) < others else ""
    return f"; every other {usable}camera is at least {least} times as uncertain"


def _trade_off_words(tree: xr.DataTree, taken: str) -> str:
    """Which candidate ranks first if all criteria are weighed, if it is another one."""
    ranked = candidates_by_rank(tree)
    if not ranked or not taken or ranked[0].title == taken:
        return ""
    most = ranked[0].ranks[0]
    weights = f" for {pretty(most, FRACTION, 2)} of the possible weights" if most < 1.0 else ""
    criteria = [in_words(str(criterion)) for criterion in group(tree, "criteria")["weighed"].values]
    weighed = f"{listed(criteria)} all" if 1 < len(criteria) <= _MEASURED else "all criteria"
    return f"; if {weighed} count, {with_article(ranked[0].title)} ranks first{weights}"


def says_stretches(tree: xr.DataTree, said: str) -> bool:
    """Whether a headline names the best cameras of all distances."""
    words = _stretch_words(tree, best_ranges(tree)).replace("\N{NO-BREAK SPACE}", " ")
    # Without the first letter, which is a capital in the headline.
    return bool(words) and words[1:] in said and _CHANGES not in words


def _stretch_words(tree: xr.DataTree, ranges: Sequence[BestRange]) -> str:
    """Which camera to take from which distance to which."""
    taken = [stretch for stretch in ranges if stretch.cameras]
    if not ranges:
        return ""
    if not taken:
        causes = {why for _, why in never_usable(tree, even_all=True)}
        why = f" ({causes.pop()})" if len(causes) == 1 else ""  # if they differ, the report gives each camera's cause
        return f"no camera is usable from {plain_span(ranges[0].near, ranges[-1].far)}{why}"
    if len(group(tree, "depth")["camera"]) == 1:
        return _of_one_camera(tree, taken)
    shown = taken
    if len(taken) > _MOST_STRETCHES:  # the longest, in factors of distance
        longest = sorted(taken, key=lambda stretch: stretch.far / stretch.near)[-3:]
        shown = [stretch for stretch in taken if stretch in longest]
    parts, last = [], math.nan
    for number, stretch in enumerate(shown):
        near, far = stretch.where.split(" to ")
        begins = "" if stretch.near == last else f"from {near} "
        which = listed(list(map(with_article, stretch.cameras)), "or") + " (equally uncertain)" * (
            len(stretch.cameras) > 1
        )
        parts.append(f"{begins}to {far} {'' if number else 'take '}{which}")
        last = stretch.far
    words = ", ".join(parts)
    if len(shown) < len(taken):
        return f"{words}; {_CHANGES} {len(taken) - 1} times"
    nowhere = any(not stretch.cameras for stretch in ranges)
    return f"{words}; elsewhere none meets the limits" if nowhere else words + _lead_words(tree) * (len(taken) == 1)


def _of_one_camera(tree: xr.DataTree, taken: Sequence[BestRange]) -> str:
    """The usable range of the only camera, its uncertainty at both ends, and how much larger it is off the axis."""
    camera = str(group(tree, "depth")["camera"].values[0])
    where = " and ".join(f"from {stretch.where}" for stretch in taken)
    title = with_article(camera_titles(tree)[camera])
    ratio = off_axis(tree, camera).ratio
    is_worse = _HARDLY < ratio < math.inf
    off = f" on the axis, and up to {significant(ratio, 2)} times as much off it" if is_worse else ""
    source = has(tree, "decision", "cause") and str(group(tree, "decision")["cause"].values[0])
    cause = (
        f"; on average over distance, the largest part comes from {source.replace(f' of {title}', '')}"
        if source
        else ""
    )
    return f"depth by {title} is usable {where}, with ±{' to ±'.join(uncertainty_at_ends(tree, taken))}{off}{cause}"


def uncertainty_at_ends(tree: xr.DataTree, taken: Sequence[BestRange]) -> list[str]:
    """Depth uncertainty of the only camera at both ends of its usable range, in words; one if they read the same."""
    camera, usable = group(tree, "depth")["camera"].values[0], slice(taken[0].near, taken[-1].far)
    judged = group(tree, "decision")["judged_uncertainty"].sel(camera=camera, distance=usable).values
    return list(
        dict.fromkeys(pretty(float(uncertainty), LENGTH) for uncertainty in judged[np.isfinite(judged)][[0, -1]])
    )
