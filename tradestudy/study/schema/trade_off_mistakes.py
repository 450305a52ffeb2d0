"""Checks of a trade-off: every ranked camera has each criterion, and its worst and best values differ."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence

from tradestudy.cameras.declaration import AttributesPart
from tradestudy.declarations.part import MistakeAt
from tradestudy.study.schema.criteria import DERIVED, is_number, weighed_dimension
from tradestudy.study.schema.requirement_mistakes import criterion_mistake
from tradestudy.study.schema.trade_off import TradeOffPart, WeighedPart
from tradestudy.units import UnitError, parse


def trade_off_mistakes(
    part: TradeOffPart,
    ranked: Sequence[str],
    attributes: Mapping[str, AttributesPart],
    measuring: Collection[str],
    *,
    relief: bool,
) -> Iterator[MistakeAt]:
    """Criteria that cannot be weighed, each at the key at fault.

    Parameters
    ----------
    part
        The trade-off.
    ranked
        Its cameras.
    attributes
        Declared attributes of every camera of the study.
    measuring
        Cameras that measure depth.
    relief
        Whether the study has a relief, for which criteria are derived.
    """
    for name, one in part.criteria.items():
        place = ("trade_off", "criteria", name)
        if what := _unknown(name, one, ranked, attributes, measuring, relief=relief):
            yield MistakeAt(place, what)
        else:
            yield from (MistakeAt((*place, *mistake.tail), mistake.what) for mistake in _ends(name, one, attributes))


def _unknown(
    name: str,
    one: WeighedPart,
    ranked: Sequence[str],
    attributes: Mapping[str, AttributesPart],
    measuring: Collection[str],
    *,
    relief: bool,
) -> str:
    remedy = "or name candidates without this camera"
    if one.quantity is not None:
        others = [camera for camera in ranked if camera not in measuring]
        return f"{others[0]!r} measures no depth; remove {one.quantity}, {remedy}" if others else ""
    if what := criterion_mistake(name, attributes, relief=relief):
        return what
    if name in DERIVED:
        return ""
    without = [camera for camera in ranked if not is_number(attributes[camera].others.get(name, ""))]
    return f"{without[0]!r} declares no number for it (attributes: others); add one, {remedy}" if without else ""


def _ends(name: str, one: WeighedPart, attributes: Mapping[str, AttributesPart]) -> Iterator[MistakeAt]:
    dimension = weighed_dimension(name, one.quantity, attributes.values())
    ends = {}
    for key, text in (("worst", one.worst), ("best", one.best)):
        try:
            ends[key] = parse(text, dimension)
        except UnitError as error:
            yield MistakeAt((key,), str(error))
            continue
        if abs(ends[key]) == float("inf"):
            yield MistakeAt((key,), "a finite value is expected, since scores are linear between worst and best")
    if len(ends) == 2 and ends["worst"] == ends["best"]:
        yield MistakeAt(("best",), "must differ from worst, since scores are linear between them")
