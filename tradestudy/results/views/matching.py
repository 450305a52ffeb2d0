"""Derived disparity errors in words: the lower bound for any matcher, or the error of a declared matcher."""

from __future__ import annotations

import xarray as xr

from tradestudy.results.views.groups import group, has, titles_in
from tradestudy.wording import listed

NAME = "disparity_causes"


def declared_matchers(tree: xr.DataTree) -> dict[str, str]:
    """The declared matcher in words, by title, of each camera whose disparity error is derived."""
    if not has(tree, NAME, "matcher"):
        return {}
    words = dict(zip(group(tree, NAME)["camera"].values, group(tree, NAME)["matcher"].values, strict=True))
    return {title: str(words[key]) for key, title in titles_in(tree, NAME).items() if words[key]}


def false_matches_declared(tree: xr.DataTree) -> bool:
    """Whether failed measurements contain false matches."""
    return has(tree, NAME, "false_matches") and bool((group(tree, NAME)["false_matches"] > 0.0).any())


def at_the_bound(tree: xr.DataTree) -> tuple[str, ...]:
    """Titles of the cameras whose derived disparity error is the bound, because they declare no matcher."""
    if not has(tree, NAME):
        return ()
    real = declared_matchers(tree)
    return tuple(title for title in titles_in(tree, NAME).values() if title not in real)


def best_of_any_matcher(titles: tuple[str, ...]) -> str:
    """The caveat on errors at the bound of matching; empty if no camera has such errors."""
    if not titles:
        return ""
    what = "disparity error of {} is a lower bound" if len(titles) == 1 else "disparity errors of {} are lower bounds"
    return f"The {what.format(listed(titles))} derived from the picture; no matcher does better."
