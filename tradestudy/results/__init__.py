"""The single table of results: every variable with its dimensions, unit, symbol and source.

`results.nc` contains only variables that are declared here, each with a unit ("1" for a plain number).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from tradestudy.results.calibration import CALIBRATION, RANKS, SENSITIVITY
from tradestudy.results.cost import COST
from tradestudy.results.datasheet import DATASHEET
from tradestudy.results.depth import DEPTH, DEPTH_FIELD, DEPTH_MAP, DISPARITY_CAUSES
from tradestudy.results.depth_loop import DEPTH_LOOP
from tradestudy.results.depth_maps import DEPTH_MAPS
from tradestudy.results.depth_of_field import DEPTH_OF_FIELD
from tradestudy.results.effects import EFFECTS
from tradestudy.results.hard_cases import HARD_CASES
from tradestudy.results.pictures import PICTURES
from tradestudy.results.questions import CLAIMS, DECISION, REQUIREMENTS
from tradestudy.results.registers import ASSUMPTIONS, CAMERAS, CONTRADICTIONS, CRITERIA
from tradestudy.results.trade_off import TRADE_OFF
from tradestudy.results.value_of_information import VALUE_OF_INFORMATION
from tradestudy.results.variable import PAPER, Variable
from tradestudy.results.wave_optics import FRESNEL_VALIDITY, IMAGES, POINT_SPREAD

if TYPE_CHECKING:
    import xarray as xr

__all__ = ["FORMAT_VERSION", "GROUPS", "PAPER", "Variable", "dataset"]

FORMAT_VERSION: Final = 8

GROUPS: Final[Mapping[str, Mapping[str, Variable]]] = {
    "cameras": CAMERAS,
    "depth": DEPTH,
    "depth_at_places": DEPTH,
    "depth_field": DEPTH_FIELD,
    "depth_map": DEPTH_MAP,
    "disparity_causes": DISPARITY_CAUSES,
    "depth_loop": DEPTH_LOOP,
    "depth_of_field": DEPTH_OF_FIELD,
    "criteria": {**CRITERIA, **TRADE_OFF},
    "decision": {**DECISION, **RANKS},
    "calibration": CALIBRATION,
    "sensitivity": SENSITIVITY,
    "fresnel_validity": FRESNEL_VALIDITY,
    "images": IMAGES,
    "point_spread": POINT_SPREAD,
    "hard_cases": HARD_CASES,
    "effects": EFFECTS,
    "cost": COST,
    "claims": CLAIMS,
    "datasheet": DATASHEET,
    "pictures": {**PICTURES, **DEPTH_MAPS},
    "requirements": REQUIREMENTS,
    "value_of_information": VALUE_OF_INFORMATION,
    "assumptions": ASSUMPTIONS,
    "contradictions": CONTRADICTIONS,
}


def dataset(
    group: str,
    values: Mapping[str, Any],
    coordinates: Mapping[str, Sequence[Any] | np.ndarray[Any, Any]],
    *,
    leading: tuple[str, ...] = (),
    attributes: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """Build one group of the results from arrays in the declared order of dimensions.

    Parameters
    ----------
    group
        Name of the group in `GROUPS`.
    values
        One array per variable; variables that the study does not ask for are left out.
    coordinates
        Labels along each dimension that has them.
    leading
        Dimensions of the study's sweep, before the declared ones.
    attributes
        Attributes of the group.
    """
    import xarray as xr  # here, because plans use only the words of the results

    declared = GROUPS[group]
    variables = {}
    for name, value in values.items():
        spec = declared[name]
        attrs = {"units": spec.units, "long_name": spec.long_name}
        attrs |= {key: text for key in ("symbol", "reference", "error") if (text := getattr(spec, key))}
        array = np.asarray(value)
        swept = leading if array.ndim == len(leading) + len(spec.dims) else ()
        variables[name] = (swept + spec.dims, array.astype(object) if array.dtype.kind == "U" else array, attrs)
    coords = {
        name: np.asarray(labels, dtype=object) if len(labels) > 0 and isinstance(labels[0], str) else labels
        for name, labels in coordinates.items()
    }
    result = xr.Dataset(variables, coords=coords, attrs=dict(attributes or {}))
    if "distance" in result.coords:
        result["distance"].attrs = {"units": "m", "long_name": "object distance", "symbol": "a"}
    return result
