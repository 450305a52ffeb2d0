"""Trade-offs: criteria with their worst and best values, and what is known about their weights."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from tradestudy.cameras.declaration import AttributeName
from tradestudy.declarations.part import MistakeAt, Part, nearest_name
from tradestudy.declarations.quantities import CameraName, ObjectDistance, QuantityText, Share, distinct
from tradestudy.uncertainty.trade_off import WeightSpace, range_mistake


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

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if (self.quantity == "depth_uncertainty") != (self.at is not None):
            raise MistakeAt((), "depth_uncertainty and at (its distance) belong together")
        if self.range[0] > self.range[1]:
            raise MistakeAt(("weight",), "a range goes from the smallest to the largest weight")
        return self

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

    @model_validator(mode="after")
    def _possible_weights(self) -> Self:
        declared = [name for name, one in self.criteria.items() if one.weight is not None]
        if self.order is not None:
            unknown = [
                MistakeAt(("order", i), f"no criterion is called {name!r}{nearest_name(name, self.criteria)}")
                for i, name in enumerate(self.order)
                if name not in self.criteria
            ]
            if unknown:
                raise MistakeAt.several(unknown)
            if declared:
                raise MistakeAt(("order",), f"{declared[0]!r} has a weight; give an order or weights, not both")
        if what := range_mistake(*zip(*(one.range for one in self.criteria.values()), strict=True)):
            raise MistakeAt(("criteria", declared[-1], "weight"), what)
        return self

    @property
    def weights(self) -> WeightSpace:
        """The space of possible weights, in the order of the criteria."""
        low, high = zip(*(one.range for one in self.criteria.values()), strict=True)
        names = list(self.criteria)
        return WeightSpace(low=low, high=high, order=tuple(names.index(name) for name in self.order or ()))
