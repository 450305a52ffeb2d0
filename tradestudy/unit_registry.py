"""The units of study files, and how they are looked up: common ones in a table, all others by pint."""

from __future__ import annotations

import functools
import math
import re
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tradestudy.errors import nearest

if TYPE_CHECKING:
    import pint

DEGREE = math.pi / 180.0

# All units of study files; pint's own registry has a thousand more and takes 0.2 s to build.
_DEFINITIONS = """
nano- = 1e-9 = n-
micro- = 1e-6 = u-
milli- = 1e-3 = m-
centi- = 1e-2 = c-
hecto- = 1e2 = h-
kilo- = 1e3 = k-
mega- = 1e6 = M-
giga- = 1e9 = G-
metre = [length] = m = meter
angstrom = 1e-10 * metre
inch = 0.0254 * metre = in = inches
yard = 0.9144 * metre = yd
foot = 0.3048 * metre = ft = feet
astronomical_unit = 149597870700 * metre = au = AU
second = [time] = s
minute = 60 * second = min
hour = 3600 * second = h
kilogram = [mass] = kg
gram = 1e-3 * kilogram = g
watt = [power] = W
bit = [data]
byte = 8 * bit = B
radian = [angle] = rad
steradian = radian ** 2 = sr
degree = 0.017453292519943295 * radian = deg
arcminute = degree / 60 = arcmin
arcsecond = degree / 3600 = arcsec
kelvin = [temperature] = K
degree_Celsius = kelvin; offset: 273.15 = degC = celsius
pascal = [pressure] = Pa
bar = 1e5 * pascal
atmosphere = 101325 * pascal = atm
pixel = [pixel] = px
electron = [electron] = e
photon = [photon]
digital_number = [digital_number] = DN
wave = [wave]
percent = 0.01
ppm = 1e-6
"""

_COMMON_UNITS = (
    "nm", "um", "mm", "cm", "m", "km", "in", "ft", "au", "metres", "millimetres",
    "deg", "rad", "mrad", "arcmin", "arcsec", "px", "pixels", "electrons", "photons", "DN",
    "waves", "percent", "ppm", "K", "degC", "Pa", "kPa", "hPa", "bar", "s", "ms", "min", "h",
    "g", "kg", "W", "mW", "MB", "GB",
)  # fmt: skip
_LONGEST_UNIT = 60
_CELSIUS = re.compile(r"\b(?:degC|celsius|degree_Celsius)\b")
# "e-" and "ke-", but neither an exponent, as in 1e-3, nor the end of another unit.
_ELECTRON = re.compile(r"(?<![A-Za-z])(k?)e\^?-(?!\d)")
_FACTOR = re.compile(r"(?P<name>[A-Za-z][A-Za-z_]*)(?:(?:\^|\*\*)(?P<power>-?\d))?")


@dataclass(frozen=True, kw_only=True)
class ResolvedUnit:
    """A unit of a study file, resolved: SI value = number × scale + offset."""

    scale: float
    offset: float
    dimensions: frozenset[tuple[str, object]]


# The most common units and the SI unit of every dimension, with pint's values: importing pint takes longer than reading
# a study.
_USUAL: Mapping[str, ResolvedUnit] = {
    unit: ResolvedUnit(
        scale=scale, offset=0.0, dimensions=frozenset({(base.removeprefix("1/"), power)} if base else ())
    )
    for base, units in {
        "[length]": {"nm": 1e-9, "um": 1e-6, "mm": 1e-3, "cm": 1e-2, "m": 1.0, "km": 1e3},
        "1/[length]": {"1/m": 1.0, "1/mm": 1e3},
        "[angle]": {"deg": DEGREE, "rad": 1.0},
        "[time]": {"s": 1.0, "h": 3600.0},
        "[temperature]": {"K": 1.0},
        "1/[temperature]": {"1/K": 1.0, "ppm/K": 1e-6},
        "[pressure]": {"Pa": 1.0, "hPa": 100.0, "kPa": 1000.0},
        "[mass]": {"g": 1e-3, "kg": 1.0},
        "[power]": {"mW": 1e-3, "W": 1.0},
        "[data]": {"bit": 1.0, "MB": 8e6},
        "[pixel]": {"px": 1.0},
        "[electron]": {"electron": 1.0, "electrons": 1.0},
        "[photon]": {"photon": 1.0},
        "[wave]": {"wave": 1.0, "waves": 1.0},
        "": {"percent": 0.01},
    }.items()
    for power in [-1 if base.startswith("1/") else 1]
    for unit, scale in units.items()
} | {
    "DN/electron": ResolvedUnit(
        scale=1.0, offset=0.0, dimensions=frozenset({("[digital_number]", 1), ("[electron]", -1)})
    )
}
_ABSOLUTE: Mapping[str, ResolvedUnit] = {
    "degC": ResolvedUnit(scale=1.0, offset=273.15, dimensions=frozenset({("[temperature]", 1)}))
}


def resolve_unit(unit: str, *, absolute: bool) -> ResolvedUnit | str:
    """Look a unit up; for an unknown one, return the end of an error message."""
    return (_ABSOLUTE.get(unit) if absolute else None) or _USUAL.get(unit) or _resolve_by_pint(unit, absolute=absolute)


@functools.lru_cache(maxsize=1024)
def _resolve_by_pint(unit: str, *, absolute: bool) -> ResolvedUnit | str:
    registry = _registry()
    spelled = _ELECTRON.sub(r"\1electron", unit.replace("°", "deg"))
    compact = re.sub(r"\s+", "*", re.sub(r"\s*(\*\*|[*/^])\s*", r"\1", spelled)).replace("**", "^")
    if len(compact) > _LONGEST_UNIT:
        return "does not end in a unit"
    for factor in re.split(r"[*/]", compact.removeprefix("1/").removeprefix("/")):
        match = _FACTOR.fullmatch(factor)
        if match is None:
            return "does not end in a unit"
        if match["name"] not in registry:
            return f"has the unknown unit '{match['name']}'{_suggestion(match['name'])}"
    if not (absolute and _CELSIUS.fullmatch(compact)):
        compact = _CELSIUS.sub("delta_degree_Celsius", compact)
    # The values of one and zero units give scale and offset, also of units such as degC that have both.
    one, zero = (
        registry.Quantity(number, registry.parse_units("1" + compact if compact[0] == "/" else compact))
        for number in (1.0, 0.0)
    )
    one_si, offset = (quantity.to_root_units().magnitude for quantity in (one, zero))
    dimensions = frozenset(one.dimensionality.items())
    return ResolvedUnit(scale=one_si - offset, offset=offset, dimensions=dimensions)


@functools.cache
def _registry() -> pint.UnitRegistry[float]:
    """Build the registry of the units above; pint is imported only here, because its import is slow."""
    if sys.modules.get("pint", ...) is None:  # hidden by the command line
        del sys.modules["pint"]
    import pint

    return pint.UnitRegistry(_DEFINITIONS.strip().splitlines(), cache_folder=None)


def _suggestion(unit: str) -> str:
    """The most similar common unit, as the end of a message; empty if there is none."""
    close = nearest(unit, _COMMON_UNITS)
    return f" (nearest: '{close}')" if close else ""
