"""Lens models as study files declare them: the name of a family, and its coefficients by name."""

from __future__ import annotations

import inspect
import math
import re
from functools import reduce
from operator import or_
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field, WithJsonSchema, create_model, model_validator

from tradestudy import units
from tradestudy.declarations.part import MistakeAt, Part
from tradestudy.declarations.quantities import quantity
from tradestudy.errors import OutOfRangeError
from tradestudy.optics.lens_families import ANGLES, FAMILIES, STARTS
from tradestudy.optics.lens_model import LensModel, Rational
from tradestudy.wording import lens_in_words

_MODEL = "Name of the lens model."
_ABOUT = {
    "rational": "Radial, tangential and thin-prism distortion with a tilted sensor, as in OpenCV. Here, x and y are "
    "the slopes of a ray, and r² = x² + y². Radial distortion multiplies x and y by (1 + k₁r² + k₂r⁴ + k₃r⁶)/"
    "(1 + k₄r² + k₅r⁴ + k₆r⁶)",
    "kannala-brandt": "The fisheye model of Kannala and Brandt, as in OpenCV and Kalibr (equidistant). At focal "
    "length 1, the image radius is θ + k₁θ³ + k₂θ⁵ + k₃θ⁷ + k₄θ⁹, where θ is the angle from the optical axis",
    "fov": "The fisheye model of Devernay and Faugeras, which has a single coefficient, w. At focal length 1, a ray at "
    "the angle θ from the optical axis has the image radius atan(2 tan(w/2) tan θ)/w",
    "omni": "The omnidirectional model of Mei and Rives: points are projected onto a unit sphere around the camera, "
    "and from there through a second centre of projection onto a plane at unit distance from that centre. The "
    "positions in this plane are then distorted radially and tangentially; x and y are the coordinates of a point in "
    "this plane before distortion, and r² = x² + y². Radial distortion multiplies x and y by 1 + k₁r² + k₂r⁴",
    "double-sphere": "The double-sphere model of Usenko, Demmel and Cremers: points are projected onto two unit "
    "spheres in turn, and from the second one through a pinhole onto a plane",
    "eucm": "The extended unified camera model of Khomutenko, Garcia and Martinet: points are projected onto an "
    "ellipsoid around the camera, and from there through a pinhole onto a plane",
}


class LensModelPart(Part):
    """A lens model; omitted coefficients are zero."""

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


class FittedLensModelPart(LensModelPart):
    """A lens model to be fitted; coefficients that are given but not fitted stay fixed."""

    fitted: tuple[str, ...]

    @model_validator(mode="after")
    def _each_once(self) -> FittedLensModelPart:
        if repeated := sorted({name for name in self.fitted if self.fitted.count(name) > 1}):
            raise MistakeAt(("fitted",), f"names {', '.join(repeated)} more than once")
        return self

    def lens_model(self) -> LensModel:
        """The model in SI from which the fit starts: each coefficient as given, else from `STARTS`, else zero."""
        coefficients = {name: getattr(self, name) for name in self.family.coefficient_names()}
        start = {name: value for name, value in coefficients.items() if value is not None}
        return self.family(**{**STARTS.get(self.family.name, {}), **start})


def _meanings(family: type[LensModel]) -> dict[str, str]:
    """What each coefficient means, from the parameters in the docstring of its family, without units."""
    parameters = (inspect.getdoc(family) or "").partition("----------\n")[2].partition("\n\n")[0]
    entries = re.findall(r"^(\w.*)((?:\n +.*)+)", parameters, re.MULTILINE)
    meanings = {names: " ".join(meaning.split()) for names, meaning in entries}
    return {name: re.sub(r" \[\w+\]", "", meaning) for names, meaning in meanings.items() for name in names.split(", ")}


def _coefficient(family: type[LensModel], name: str) -> Any:
    """The type of a coefficient; it says "of either sign" only if the family accepts negative values."""
    dimension = units.ANGLE if name in ANGLES else units.NUMBER
    reader, schema = quantity(dimension)
    try:
        family(**{**STARTS.get(family.name, {}), name: -0.1})
    except OutOfRangeError:
        schema = WithJsonSchema({**(schema.json_schema or {}), "title": dimension.name})
    return Annotated[float, reader, schema]


def _fitted_part_of(family: type[LensModel]) -> type[FittedLensModelPart]:
    """The part that declares every coefficient in its dimension, and which of them are fitted."""
    names = family.coefficient_names()
    one_of: Any = Literal[names]
    usual = names if family is not Rational else ("k1", "k2", "p1", "p2", "k3")
    fields: dict[str, Any] = {
        "model": (Literal[family.name], Field(description=_MODEL)),
        "fitted": (
            tuple[one_of, ...],
            Field(default=usual, description="Names of the coefficients that are fitted to the corners."),
        ),
    }
    meanings = _meanings(family)
    for name in names:
        start = STARTS.get(family.name, {}).get(name, 0.0)
        default = f"{math.degrees(start):.3g} deg" if name in ANGLES else f"{start:g}"
        field = Field(default=None, description=f"{meanings[name]} Default: {default}.")
        fields[name] = (_coefficient(family, name) | None, field)
    several = "coefficients below; those that `fitted` omits keep their values"
    made = create_model(
        f"Fitted{family.__name__}Part",
        __base__=FittedLensModelPart,
        __doc__=f"{_ABOUT[family.name]}. The fit starts from the {several if len(names) > 1 else 'coefficient below'}.",
        **fields,
    )
    made.family = family
    return made


def _part_of(family: type[LensModel]) -> type[LensModelPart]:
    """The part that declares every coefficient in its dimension; those without a default must be given."""
    fields: dict[str, Any] = {"model": (Literal[family.name], Field(description=_MODEL))}
    optional, meanings = family.optional_names(), _meanings(family)
    for name in family.coefficient_names():
        field = Field(default=0.0 if name in optional else ..., description=meanings[name])
        fields[name] = (_coefficient(family, name), field)
    made = create_model(f"{family.__name__}Part", __base__=LensModelPart, __doc__=f"{_ABOUT[family.name]}.", **fields)
    made.family = family
    return made


def fitted_words(part: FittedLensModelPart | None) -> str:
    """A lens model to be fitted to corners in words: its name, its fitted coefficients, and those that stay fixed."""
    if part is None:
        return lens_in_words()
    unfitted = {name: getattr(part, name) for name in part.family.coefficient_names() if name not in part.fitted}
    fixed = "".join(f", {name} = {value:g}" for name, value in unfitted.items() if value is not None)
    return lens_in_words(part.model, part.fitted, fixed)


if TYPE_CHECKING:
    AnyLensModel = LensModelPart
    FittedLensModel = FittedLensModelPart
else:
    FittedLensModel = Annotated[reduce(or_, map(_fitted_part_of, FAMILIES.values())), Field(discriminator="model")]
    AnyLensModel = Annotated[reduce(or_, map(_part_of, FAMILIES.values())), Field(discriminator="model")]
