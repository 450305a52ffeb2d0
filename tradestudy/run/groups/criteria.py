"""/criteria: the comparison of all cameras by what is not a curve."""

from __future__ import annotations

import xarray as xr

from tradestudy.analysis.trade_criteria import CRITERIA, Attribute, Relief, declared_others
from tradestudy.effects.selection import Selection
from tradestudy.results import dataset
from tradestudy.run.groups.depth_of_field import acting_criteria
from tradestudy.study.definition import StudyDefinition
from tradestudy.study.schema.depth_of_field import CriteriaPart, DepthOfFieldPart

_MISSING = Attribute(text="not said", basis="")


def criteria_group(
    definition: StudyDefinition, asked: CriteriaPart, focus: DepthOfFieldPart, selection: Selection
) -> xr.Dataset:
    """/criteria over (camera, criterion), each value with what it rests on; what is sharp as the selection has it."""
    parts, cameras = definition.file.cameras, definition.case.all_cameras
    relief = Relief(
        near=focus.scene[0],
        far=focus.scene[1],
        sharp=next(iter(acting_criteria(focus, definition.case.wavelength, selection).values())),
        step_height=asked.step_height,
        surface_tilt=asked.surface_tilt,
    )
    others = list(dict.fromkeys(name for part in parts.values() for name in part.attributes.others))
    rows = [
        [criterion.of(camera, parts[name], relief) for criterion in CRITERIA]
        + [declared_others(parts[name].attributes).get(other, _MISSING) for other in others]
        for name, camera in cameras.items()
    ]
    paths = [*(criterion.path for criterion in CRITERIA), *(f"attributes.others.{other}" for other in others)]
    basis = [
        [attribute.basis or _basis(definition, name, path) for attribute, path in zip(row, paths, strict=True)]
        for name, row in zip(cameras, rows, strict=True)
    ]
    return dataset(
        "criteria",
        {
            "value": [[attribute.text for attribute in row] for row in rows],
            "number": [[attribute.number for attribute in row] for row in rows],
            "basis": basis,
            "number_units": [*(criterion.units for criterion in CRITERIA), *[""] * len(others)],
            "says": [*(criterion.says for criterion in CRITERIA), *["as declared"] * len(others)],
        },
        {"camera": list(cameras), "criterion": [*(criterion.name for criterion in CRITERIA), *others]},
        attributes={
            "scene_near": relief.near,
            "scene_far": relief.far,
            "step_height": relief.step_height,
            "surface_tilt": relief.surface_tilt,
        },
    )


def _basis(definition: StudyDefinition, camera: str, path: str) -> str:
    """What a declared value rests on; plainly "declared" where the study does not say."""
    place = ("cameras", camera, *path.split("."))
    annotation = definition.document.annotations.get(place)
    if annotation is not None and annotation.basis is not None:
        return annotation.basis
    return "declared" if definition.document.entry(place) is not None else ""
