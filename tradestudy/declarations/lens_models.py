"""Lens models as study files declare them: the name of a family, and its coefficients by name."""

from __future__ import annotations

from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field, create_model, model_validator

from tradestudy import units
from tradestudy.declarations.mistakes import MistakeAt
from tradestudy.declarations.part import Part
from tradestudy.declarations.quantities import quantity
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.lens_models.families import ANGLES, FAMILIES
from tradestudy.optics.lens_models.lens_model import LensModel


class LensModelPart(Part):
    """A lens model; coefficients that are left out are zero."""

    family: ClassVar[type[LensModel]]
    model: str

    @model_validator(mode="after")
    def _possible(self) -> LensModelPart:
        try:
            self.lens_model()
        except OutOfRangeError as error:
            raise MistakeAt((), str(error)) from None
        return self

    def lens_model(self) -> LensModel:
        """The lens model in SI."""
        return self.family(**{name: getattr(self, name) for name in self.family.coefficient_names()})


def _part_of(family: type[LensModel]) -> type[LensModelPart]:
    """The part of a family, with every coefficient in its dimension; those that have no default must be given."""
    fields: dict[str, Any] = {"model": (Literal[family.name], ...)}
    optional = family.optional_names()
    for name in family.coefficient_names():
        unit = units.ANGLE if name in ANGLES else units.NUMBER
        fields[name] = (Annotated[float, *quantity(unit)], 0.0 if name in optional else ...)
    made = create_model(f"{family.__name__}Part", __base__=LensModelPart, __doc__=LensModelPart.__doc__, **fields)
    made.family = family
    return made


if TYPE_CHECKING:
    AnyLensModel = LensModelPart
else:
    AnyLensModel = Annotated[reduce(or_, map(_part_of, FAMILIES.values())), Field(discriminator="model")]
