"""Requirements and trade-offs of a study: quantities with their bounds, and criteria with their weights."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Annotated, ClassVar, Final, Literal

from pydantic import AfterValidator, Field

from tradestudy.cameras.declaration import AttributeName, AttributesPart
from tradestudy.declarations.part import MistakeAt, Part, nearest_name
from tradestudy.declarations.quantities import (
    CameraName,
    ObjectDistance,
    PositiveCount,
    PositiveFraction,
    PositiveLength,
    PositiveNumber,
    PositiveShare,
    QuantityText,
    Share,
    Span,
    Text,
    common_dimension,
    distinct,
)
from tradestudy.study.schema.questions import DepthOfFieldPart
from tradestudy.uncertainty.trade_off import WeightSpace, range_mistake
from tradestudy.units import DATA, DURATION, FRACTION, LENGTH, NUMBER, SOLID_ANGLE, Dimension, UnitError, parse

DERIVED: Final[Mapping[str, Dimension | None]] = {
    "moving parts": NUMBER,
    "images per scene": NUMBER,
    "time per scene": DURATION,
    "data per depth map": DATA,
    "resolved samples": NUMBER,
    "aperture": LENGTH,
    "light gathered": SOLID_ANGLE,
    "size": None,  # text with three lengths
    "hidden beside a step": LENGTH,
    "foreshortening": NUMBER,
}
"""Criteria derived for every camera of a study that has a relief, with their dimensions."""
_DECLARED: Final = {"moving parts": "moving_parts", "size": "envelope"}


def criterion_names(attributes: Iterable[AttributesPart], *, relief: bool) -> list[str]:
    """Names of all criteria of a study: those derived for its relief, if any, and those that cameras declare."""
    declared = [name for part in attributes for name in part.others]
    return list(dict.fromkeys([*(DERIVED if relief else ()), *declared]))


def criterion_dimension(name: str, attributes: Iterable[AttributesPart]) -> Dimension | None:
    """The dimension of a criterion; None for text, or for numbers with units of different kinds."""
    if name in DERIVED:
        return DERIVED[name]
    numbers = [part.others[name] for part in attributes if is_number(part.others.get(name, ""))]
    dimension = common_dimension(*numbers) if numbers else None
    # Plain numbers are shown as such, not in per cent.
    return NUMBER if dimension is FRACTION and all(text.strip()[-1] in "0123456789." for text in numbers) else dimension


def weighed_dimension(name: str, quantity: str | None, attributes: Iterable[AttributesPart]) -> Dimension:
    """The dimension of a criterion in a valid trade-off: a length if the criterion is computed."""
    dimension = LENGTH if quantity is not None else criterion_dimension(name, attributes)
    assert dimension is not None
    return dimension


def is_number(text: str) -> bool:
    """Whether a declared attribute is a finite number, with or without a unit, and not text."""
    return text[:1] in "+-.0123456789" and text != "" and common_dimension(text) is not None


Risk = Annotated[PositiveFraction, Field(lt=0.5)]


_AT = "Instead of `over`: the only distance at which the requirement must hold."


class _OverOrAtPart(Part):
    """The distances that count: a range, or a single one."""

    exactly_one: ClassVar[tuple[tuple[str, ...], ...]] = (("over", "at"),)

    over: Span | None = Field(
        default=None, description="Nearest and farthest of the distances at which the requirement must hold."
    )
    at: ObjectDistance | None = Field(default=None, description=_AT)

    @property
    def distances(self) -> tuple[float, ...]:
        """Nearest and farthest distance that count [m]; a single one is both."""
        return _ends(self.over, self.at)


def _ends(over: tuple[float, ...] | None, at: float | None) -> tuple[float, ...]:
    return over or (() if at is None else (at, at))


class BoundOverPart(_OverOrAtPart):
    """An upper bound on the depth uncertainty, absolute or relative to the distance."""

    exactly_one = (("over", "at"), ("below", "below_relative"))

    below: PositiveLength | None = Field(default=None, description="Value below which the depth uncertainty must stay.")
    below_relative: PositiveFraction | None = Field(
        default=None, description="Instead of `below`: the bound as a fraction of the distance."
    )

    @property
    def is_relative(self) -> bool:
        """Whether the bound is a fraction of the distance."""
        return self.below is None

    @property
    def limit(self) -> float:
        """The bound, in metres or as a fraction of the distance."""
        return self.below if self.below is not None else self.below_relative or 0.0


class UsablePart(_OverOrAtPart):
    """The distances at which the camera must be usable."""


class ShareAbovePart(_OverOrAtPart):
    """A lower bound on a fraction."""

    above: Share = Field(description="Smallest fraction that meets the requirement.")


class ShareBelowPart(_OverOrAtPart):
    """An upper bound on a fraction."""

    below: PositiveShare = Field(description="Value below which the fraction must stay.")


class LengthBelowPart(_OverOrAtPart):
    """An upper bound on a length."""

    below: PositiveLength = Field(description="Value below which the length must stay.")


class SharpPart(Part):
    """The distances that must be sharp, or the smallest total depth of field that meets the requirement."""

    exactly_one = (("over", "at", "above"),)

    over: Span | None = Field(
        default=None, description="Nearest and farthest distance of the range that must be sharp throughout."
    )
    at: ObjectDistance | None = Field(default=None, description=_AT)
    above: PositiveLength | None = Field(
        default=None, description="Instead of `over`: smallest total depth of field that meets the requirement."
    )
    criterion: Text | None = Field(
        default=None,
        description="Name of one of the blur criteria that the top-level key depth_of_field lists under `criteria`; "
        "default: the first.",
    )

    @property
    def distances(self) -> tuple[float, ...]:
        """Nearest and farthest distance that must be sharp [m]; empty for a smallest depth of field."""
        return _ends(self.over, self.at)


class RefocusablePart(Part):
    """The distances on which the camera must be able to refocus, or the smallest number of distinct planes."""

    exactly_one = (("over", "at", "planes"),)

    over: Span | None = Field(
        default=None, description="Nearest and farthest distance of the range that must be refocusable throughout."
    )
    at: ObjectDistance | None = Field(default=None, description=_AT)
    planes: PositiveCount | None = Field(
        default=None, description="Instead of `over`: smallest number of distinct planes that meets the requirement."
    )

    @property
    def distances(self) -> tuple[float, ...]:
        """Nearest and farthest distance that must be refocusable [m]; empty for a number of planes."""
        return _ends(self.over, self.at)


class RefocusedDepthOfFieldPart(Part):
    """A bound on the depth of field of a picture that is refocused on a distance."""

    exactly_one = (("below", "above"),)

    at: ObjectDistance = Field(description="Distance on which the picture is refocused.")
    below: PositiveLength | None = Field(default=None, description="Value below which the depth of field must stay.")
    above: PositiveLength | None = Field(
        default=None, description="Instead of `below`: smallest depth of field that meets the requirement."
    )
    limits: Literal["blur", "rays"] = Field(
        default="blur",
        description="Depth of field by refocusing.blur, or by rays from edges of pixels through edges of microlenses.",
    )

    @property
    def distances(self) -> tuple[float, ...]:
        """The distance that counts [m], twice."""
        return self.at, self.at

    @property
    def bound(self) -> float:
        """The bound [m]."""
        return self.below if self.below is not None else self.above or 0.0


class CriterionPart(Part):
    """A bound on a criterion that cameras declare under attributes.others, or that the program derives."""

    exactly_one = (("below", "above"),)

    name: Text = Field(
        description="Name of the criterion: one of attributes.others or, in a study with `relief`, one that the "
        "program derives: `moving parts`, `images per scene`, `time per scene`, `data per depth map`, `resolved "
        "samples`, `aperture`, `light gathered`, `hidden beside a step` or `foreshortening`."
    )
    below: QuantityText | None = Field(
        default=None, description="Value below which the criterion must stay, with its unit."
    )
    above: QuantityText | None = Field(
        default=None,
        description="Instead of `below`: smallest value of the criterion that meets the requirement, with its unit.",
    )

    @property
    def side(self) -> str:
        """The key of the bound: the side on which the value must lie."""
        return "below" if self.below is not None else "above"

    @property
    def bound(self) -> str:
        """The bound with its unit."""
        return self.below if self.below is not None else self.above or ""


class GuardBandPart(Part):
    """How far a value must stay from its bound.

    It is given as a number of standard errors of the value, or as the largest acceptable risk that a requirement counts
    as met although its bound is violated.

    It affects requirements on depth_uncertainty and failed_fraction, but not those on `usable`, `overlap` or
    lateral_resolution; a requirement on depth_of_field, on refocusing or on a `criterion` does not accept it.
    """

    exactly_one = (("standard_errors", "risk"),)

    standard_errors: PositiveNumber | None = Field(
        default=None, description="Width of the guard band, in standard errors of the value."
    )
    risk: Risk | None = Field(
        default=None,
        description="Instead of standard_errors: largest probability, below 50 %, that the bound is violated "
        "although the requirement counts as met.",
    )

    @property
    def width(self) -> float:
        """Width of the guard band, in standard errors of the value."""
        if self.standard_errors is not None:
            return self.standard_errors
        from statistics import NormalDist

        assert self.risk is not None  # one of the two is given
        return -NormalDist().inv_cdf(self.risk)


_OF_REFOCUSING = ("refocusing", "refocused_depth_of_field")
_WITHOUT_USABLE_RANGE = ("depth_of_field", *_OF_REFOCUSING, "criterion")
_OF_ANY_CAMERA = ("lateral_resolution", *_WITHOUT_USABLE_RANGE)
_QUANTITIES = ("depth_uncertainty", "usable", "overlap", "failed_fraction", *_OF_ANY_CAMERA)
MeasuredPart = BoundOverPart | ShareAbovePart | ShareBelowPart | LengthBelowPart
Required = MeasuredPart | UsablePart | SharpPart | RefocusablePart | RefocusedDepthOfFieldPart | CriterionPart


class RequirementPart(Part):
    """A requirement on one quantity, to be met by a named camera, by at least one camera, or by every camera."""

    exactly_one = (_QUANTITIES,)

    says: Text = Field(description="The requirement in words.")
    camera: CameraName = Field(
        description="Name of the camera that must meet the requirement, `any` if at least one camera must, or "
        "`all` if every camera must."
    )
    priority: Literal["must", "should"] = Field(
        default="must",
        description="Whether the requirement is binding (`must`), so that a run with `--strict` fails if it is not "
        "met, or only desirable (`should`).",
    )
    depth_uncertainty: BoundOverPart | None = None
    usable: UsablePart | None = Field(default=None, description="Distances at which the camera must be usable.")
    overlap: ShareAbovePart | None = Field(
        default=None, description="Bound on the overlap of the two pictures of a stereo rig."
    )
    lateral_resolution: LengthBelowPart | None = Field(
        default=None,
        description="Bound on the size of the smallest detail on the object that the camera resolves: the largest "
        "of lateral sample, blur and radius of the Airy disc (Rayleigh's criterion), each projected to the object. "
        "Cameras that measure no depth can meet it too.",
    )
    failed_fraction: ShareBelowPart | None = Field(
        default=None,
        description="Bound on the fraction of measurements that fail; see usable_range.failed_fraction.",
    )
    depth_of_field: SharpPart | None = Field(
        default=None, description="Bound on the depth of field, also for cameras that measure no depth."
    )
    refocusing: RefocusablePart | None = Field(
        default=None,
        description="Distances on which an unfocused plenoptic camera must be able to refocus, or how many planes.",
    )
    refocused_depth_of_field: RefocusedDepthOfFieldPart | None = Field(
        default=None, description="Bound on the depth of field of a refocused picture of an unfocused plenoptic camera."
    )
    criterion: CriterionPart | None = Field(
        default=None,
        description="Bound on a criterion such as mass, power or moving parts, also for cameras that measure no depth.",
    )
    guard_band: GuardBandPart | None = None
    field: Share | None = Field(
        default=None,
        description="Part of the picture that counts for depth_uncertainty and failed_fraction: the rectangle around "
        "its middle whose corners lie at this fraction of the way to the corners of the sensor. 0 % is the optical "
        "axis, 100 % the whole picture. Default: the axis and the places of propagation.field_places.",
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if self.guard_band is not None and not self.needs_usable_range:
            yield MistakeAt(
                ("guard_band",), f"{self.quantity} has no standard error, so a guard band does not apply; remove it"
            )
        if self.field is not None and not self.varies_over_picture:
            yield MistakeAt(
                ("field",), f"{self.quantity} is judged for the picture as a whole or on its axis; remove field"
            )

    @property
    def varies_over_picture(self) -> bool:
        """Whether the requirement is on a quantity that is judged at several places of the picture."""
        return self.quantity in ("depth_uncertainty", "failed_fraction")

    @property
    def asks_for_refocusing(self) -> bool:
        """Whether the requirement applies only to cameras that can be refocused by shifting views."""
        return self.quantity in _OF_REFOCUSING

    @property
    def asks_for_depth(self) -> bool:
        """Whether the requirement applies only to cameras that measure depth."""
        return self.quantity not in _OF_ANY_CAMERA

    @property
    def needs_usable_range(self) -> bool:
        """Whether a camera that measures depth must also be usable at the distances of the requirement."""
        return self.quantity not in _WITHOUT_USABLE_RANGE

    @property
    def over(self) -> tuple[float, ...]:
        """Nearest and farthest distance that count [m], equal if only one does; empty if there are none."""
        return () if isinstance(self.required, CriterionPart) else self.required.distances

    @property
    def quantity(self) -> str:
        """The required quantity."""
        return next(quantity for quantity in _QUANTITIES if getattr(self, quantity) is not None)

    @property
    def required(self) -> Required:
        """The bound on the quantity."""
        bound: Required = getattr(self, self.quantity)
        return bound


def requirement_mistakes(
    requirements: Mapping[str, RequirementPart],
    attributes: Mapping[str, AttributesPart],
    *,
    focus: DepthOfFieldPart | None,
    relief: bool,
    measures_depth: bool,
) -> Iterator[MistakeAt]:
    """Requirements that cannot be tested on any camera of the study, each at the key at fault."""
    for key, requirement in requirements.items():
        place = ("requirements", key, requirement.quantity)
        if isinstance(requirement.required, CriterionPart):
            yield from _of_criterion(requirement.required, (*place,), attributes, relief=relief)
        elif isinstance(requirement.required, SharpPart):
            yield from _of_sharpness(requirement.required, (*place,), focus)
        elif requirement.asks_for_depth and not measures_depth:
            yield MistakeAt(place, "no camera of this study measures depth")


def attribute_mistakes(attributes: Mapping[str, AttributesPart]) -> Iterator[MistakeAt]:
    """Declared attributes with the name of a derived criterion, each at its key."""
    for camera, part in attributes.items():
        for name in part.others:
            if name in DERIVED:
                remedy = f"declare it as attributes.{_DECLARED[name]}" if name in _DECLARED else "give it another name"
                place = ("cameras", camera, "attributes", "others", name)
                yield MistakeAt(place, f"has the name of a criterion that the program derives; {remedy}")


def criterion_mistake(name: str, attributes: Mapping[str, AttributesPart], *, relief: bool) -> str:
    """Why a criterion of this name cannot be compared with a number; empty if it can."""
    names = criterion_names(attributes.values(), relief=relief)
    if name in DERIVED and not relief:
        return f"{name!r} is derived for a relief; add relief and depth_of_field"
    if name not in names:
        declared = "" if names else "; no camera declares any (attributes: {others: {mass: 380 g}})"
        return f"no camera has a criterion {name!r}{nearest_name(name, names)}{declared}"
    if criterion_dimension(name, attributes.values()) is None:
        return f"{name!r} must be a number with the same kind of unit in all cameras that declare it"
    return ""


def bound_mistake(name: str, bound: str, attributes: Mapping[str, AttributesPart]) -> str:
    """Why a bound does not fit a criterion; empty if it does."""
    dimension = criterion_dimension(name, attributes.values())
    assert dimension is not None  # only valid criteria get here
    try:
        parse(bound, dimension)
    except UnitError as error:
        return str(error)
    return ""


def _of_criterion(
    required: CriterionPart, place: tuple[str, ...], attributes: Mapping[str, AttributesPart], *, relief: bool
) -> Iterator[MistakeAt]:
    if what := criterion_mistake(required.name, attributes, relief=relief):
        yield MistakeAt((*place, "name"), what)
    elif what := bound_mistake(required.name, required.bound, attributes):
        yield MistakeAt((*place, required.side), what)


def _of_sharpness(required: SharpPart, place: tuple[str, ...], focus: DepthOfFieldPart | None) -> Iterator[MistakeAt]:
    if focus is None:
        yield MistakeAt(place, "needs the section depth_of_field, whose criteria say what counts as sharp")
    elif required.criterion is not None and required.criterion not in focus.criteria:
        names = nearest_name(required.criterion, focus.criteria)
        yield MistakeAt((*place, "criterion"), f"depth_of_field has no criterion {required.criterion!r}{names}")


class WeighedPart(Part):
    """One criterion: its quantity, its worst and best values, and its weight."""

    quantity: Literal["depth_uncertainty", "usable_near", "usable_far"] | None = Field(
        default=None,
        description="What the program computes for the criterion: the depth uncertainty, or the near or far end of "
        "the usable range. Default: the criterion that has the name of this entry; either cameras declare it under "
        "attributes.others, or the program derives it. For the criteria that the program derives, see the key `name` "
        "of a requirement on a criterion.",
    )
    at: ObjectDistance | None = Field(
        default=None, description="Distance at which the depth uncertainty counts; needed with depth_uncertainty."
    )
    worst: QuantityText = Field(description="Value that scores 0, with its unit; worse values also score 0.")
    best: QuantityText = Field(
        description="Value that scores 1, with its unit; better values also score 1. Between `worst` and `best`, the "
        "score is linear."
    )
    weight: Share | tuple[Share, Share] | None = Field(
        default=None,
        description="Weight as a fraction of the sum of all weights, or the range in which it lies; default: unknown.",
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        if (self.quantity == "depth_uncertainty") != (self.at is not None):
            yield MistakeAt((), "depth_uncertainty and at (its distance) belong together")
        if self.range[0] > self.range[1]:
            yield MistakeAt(("weight",), "a range goes from the smallest to the largest weight")

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest weight."""
        if self.weight is None:
            return 0.0, 1.0
        return self.weight if isinstance(self.weight, tuple) else (self.weight, self.weight)


class TradeOffPart(Part):
    """How the cameras rank by several criteria together, over all weights that the study allows."""

    criteria: Annotated[dict[AttributeName, WeighedPart], Field(min_length=1, max_length=20)] = Field(
        description="Criteria by name, each with its worst and best value and its weight."
    )
    order: Annotated[tuple[AttributeName, ...], Field(min_length=2), AfterValidator(distinct)] | None = Field(
        default=None,
        description="Instead of weights: names of criteria in order of decreasing importance; each weighs at least "
        "as much as the next.",
    )
    candidates: Annotated[tuple[CameraName, ...], Field(min_length=1), AfterValidator(distinct)] | None = Field(
        default=None, description="Cameras to rank; default: decision.candidates or, without them, all cameras."
    )

    def _mistakes(self) -> Iterator[MistakeAt]:
        declared = [name for name, criterion in self.criteria.items() if criterion.weight is not None]
        if self.order is not None:
            unknown = [
                MistakeAt(("order", i), f"no criterion is called {name!r}{nearest_name(name, self.criteria)}")
                for i, name in enumerate(self.order)
                if name not in self.criteria
            ]
            if unknown:
                yield MistakeAt.several(unknown)
            if declared:
                yield MistakeAt(("order",), f"{declared[0]!r} has a weight; give an order or weights, not both")
        if what := range_mistake(*zip(*(criterion.range for criterion in self.criteria.values()), strict=True)):
            yield MistakeAt(("criteria", declared[-1], "weight"), what)

    @property
    def weights(self) -> WeightSpace:
        """The space of possible weights, in the order of the criteria."""
        low, high = zip(*(criterion.range for criterion in self.criteria.values()), strict=True)
        names = list(self.criteria)
        return WeightSpace(low=low, high=high, order=tuple(names.index(name) for name in self.order or ()))


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
    for name, criterion in part.criteria.items():
        place = ("trade_off", "criteria", name)
        if what := _unknown(name, criterion, ranked, attributes, measuring, relief=relief):
            yield MistakeAt(place, what)
        else:
            mistakes = _mistakes_of_ends(name, criterion, attributes)
            yield from (MistakeAt((*place, *mistake.tail), mistake.what) for mistake in mistakes)


def _unknown(
    name: str,
    criterion: WeighedPart,
    ranked: Sequence[str],
    attributes: Mapping[str, AttributesPart],
    measuring: Collection[str],
    *,
    relief: bool,
) -> str:
    remedy = "or name candidates without this camera"
    if criterion.quantity is not None:
        without_depth = [camera for camera in ranked if camera not in measuring]
        return f"{without_depth[0]!r} measures no depth; remove {criterion.quantity}, {remedy}" if without_depth else ""
    if what := criterion_mistake(name, attributes, relief=relief):
        return what
    if name in DERIVED:
        return ""
    without = [camera for camera in ranked if not is_number(attributes[camera].others.get(name, ""))]
    return f"{without[0]!r} declares no number for it (attributes: others); add one, {remedy}" if without else ""


def _mistakes_of_ends(
    name: str, criterion: WeighedPart, attributes: Mapping[str, AttributesPart]
) -> Iterator[MistakeAt]:
    dimension = weighed_dimension(name, criterion.quantity, attributes.values())
    ends = {}
    for key, text in (("worst", criterion.worst), ("best", criterion.best)):
        try:
            ends[key] = parse(text, dimension)
        except UnitError as error:
            yield MistakeAt((key,), str(error))
            continue
        if abs(ends[key]) == float("inf"):
            yield MistakeAt((key,), "a finite value is expected, since scores are linear between worst and best")
    if len(ends) == 2 and ends["worst"] == ends["best"]:
        yield MistakeAt(("best",), "must differ from worst, since scores are linear between them")
