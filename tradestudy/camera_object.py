"""Cameras as Python sees them: their properties, their depth errors at any distance, and copies with other values."""

from __future__ import annotations

import functools
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import TYPE_CHECKING, Any, Final, Literal, cast

import numpy as np

from tradestudy.cameras import camera as in_si
from tradestudy.cameras.calibration import Calibration
from tradestudy.cameras.declaration import CameraDeclaration, DepthCameraDeclaration
from tradestudy.cameras.depth_camera import DepthCamera, UsableCriteria
from tradestudy.depth.evaluation import ERROR_SOURCES, distribution, imaged, variance_shares
from tradestudy.depth.usable import all_met, evaluate_limits, usable_intervals
from tradestudy.effects import Models
from tradestudy.errors import OutOfRangeError, TradestudyError, UnknownNameError, nearest
from tradestudy.optics.arrays import BoolArray, FloatArray
from tradestudy.results import DISTANCE, GROUPS, coordinate_names, dataset
from tradestudy.study.document import Scalar, ScalarEntry, Value, plain, scalar_text
from tradestudy.study.plausibility import unusual, warn
from tradestudy.study.prepared import Choices, PreparedStudy, apply_models
from tradestudy.study.python_values import in_metres, new_value, plain_value
from tradestudy.study.varying import SweepAxis, sweep_axes, sweep_points
from tradestudy.units import parse

if TYPE_CHECKING:
    import xarray as xr

    from tradestudy.optics.microlens_camera import MicrolensCamera

ErrorSource = Literal["noise", "calibration", "both"]
_QUANTITY: Final = re.compile(r"[+-]?[\d.]+(?:[eE][+-]?\d+)? ?[A-Za-zµ°%][\w°/*^ -]*", re.ASCII)
# SI units of numbers given to `replace`, by declaration and path; the schema finds them the first time.
_UNITS: dict[tuple[type[CameraDeclaration], str], str] = {}


@dataclass(frozen=True, eq=False)
class _Origin:
    """The study of a camera and its copies, which share its models, inferred calibrations and warned paths."""

    study: PreparedStudy
    name: str
    posteriors: dict[str, Calibration] = field(default_factory=dict)
    warned: set[str] = field(default_factory=set)

    @cached_property
    def models(self) -> Models:
        """The models that a run of the study would choose for the camera."""
        from tradestudy.models.choice import choose_depth_models

        return choose_depth_models(self.study, [self.name])[self.name]


class Camera:
    """A camera of a study; `Study.cameras` and `camera` return it.

    All numbers are in SI. Distances may be numbers [m], text with a unit, quantities of pint, lists of these, or arrays
    of any shape, also of xarray; results are `xarray.DataArray` of the same shape, with units, and a single number
    works with ``float()``. Depth errors are those that a run of the study computes, by the models that it would choose.
    When these models are first needed, the camera chooses them and, if its calibration comes from corners or a
    calibration board, infers it, which can take seconds.
    """

    def __init__(self, origin: _Origin, study: PreparedStudy) -> None:
        self._origin, self._study, self.name = origin, study, origin.name
        self._part = study.file.cameras[self.name]
        self._tree: dict[str, Any] = plain(study.document.entry(("cameras", self.name)))  # type: ignore[arg-type]
        self._quick: dict[str, str | float] = {}

    def __reduce__(self) -> tuple[type[Camera], tuple[object, ...]]:
        return Camera, (self._origin, self._changed({}))

    def __repr__(self) -> str:
        return f"<Camera {self.name}: {self.kind}, {self.title}>"

    @property
    def kind(self) -> str:
        """Kind of camera, such as ``"stereo"``."""
        return self._part.kind

    @property
    def title(self) -> str:
        """Name in figures and tables."""
        return self._part.title

    @property
    def values(self) -> dict[str, Any]:
        """The declared values as in a study file, in nested dictionaries; `replace` takes their paths."""
        return dict(self._tree)

    @property
    def focal_length(self) -> float:
        """Focal length of the lens that gathers the light [m]."""
        return self._calibrated.gathering_lens.focal_length

    @property
    def f_number(self) -> float:
        """F-number of that lens [1], its focal length divided by the diameter of its pupil."""
        return self._calibrated.gathering_lens.f_number

    @property
    def pupil_diameter(self) -> float:
        """Diameter of the entrance pupil of that lens [m]."""
        return self._calibrated.gathering_lens.pupil_diameter

    @property
    def baseline(self) -> float:
        """Largest distance between two views from which depth is measured [m]; NaN for a single view.

        For a rig, it is the distance between the lenses; for a plenoptic camera, it is the diameter of the pupil.
        """
        return self._calibrated.view_baseline or float("nan")

    @property
    def pixels(self) -> tuple[int, int]:
        """Columns and rows of pixels."""
        return self._calibrated.sensor.columns, self._calibrated.sensor.rows

    @property
    def pixel_pitch(self) -> float:
        """Distance between neighbouring pixel centres [m]."""
        return self._calibrated.sensor.pixel_pitch

    @property
    def field_of_view(self) -> tuple[float, float]:
        """Horizontal and vertical field of view at its focus (at infinity if it can focus there) [rad]."""
        left, right, top, bottom = self._calibrated.edge_angles(float("inf"))
        return left + right, top + bottom

    @property
    def models(self) -> Models:
        """The model of each effect on depth; copies by `replace` keep it."""
        self._depth  # noqa: B018 - refuses cameras that measure no depth
        return self._origin.models

    def replace(self, changes: Mapping[str, Any] | None = None, /, **values: Any) -> Camera:
        """Return the camera with other values.

        Parameters
        ----------
        changes
            New value for each dotted path in the camera, such as ``{"lenses.f_number": 4.0}``.
        **values
            New value for each key of the camera, such as ``baseline=0.1``. A mapping changes only what it contains.
            Numbers are in SI; text with a unit, quantities of pint and arrays with one element are accepted too. None
            removes a value.

        Returns
        -------
        Camera
            The changed camera. It keeps the models of this one; `Study.with_values` chooses models again. An unusual
            value causes an `ImplausibleValueWarning`, once for each path.

        Raises
        ------
        StudyError
            If no camera can have these values.
        """
        new_values = {
            path: new_value(path, value, _leaf(self._tree, path.split(".")))
            for path, value in {**(changes or {}), **values}.items()
        }
        copy = self._replaced_quickly(new_values) or Camera(self._origin, self._changed(new_values))
        for path in new_values.keys() - self._origin.warned:
            keys = path.split(".")
            if problem := unusual(["cameras", *keys], str(_leaf(copy._tree, keys))):
                self._origin.warned.add(path)
                warn(f"cameras.{self.name}.{path}: {problem}")
        return copy

    def _replaced_quickly(self, new_values: Mapping[str, Value]) -> Camera | None:
        """The changed camera without a new study; None if this cannot tell whether the values are right."""
        # Other values may require another calibration to be inferred, which only a study can tell.
        if self.name in self._study.definition.posterior_keys or not isinstance(self._part, DepthCameraDeclaration):
            return None
        tree, quick = self._tree, dict(self._quick)
        for path, value in new_values.items():
            if type(value) in (int, float):  # not bool, which is an int
                unit = _UNITS.get((type(self._part), path))
                if unit is None:
                    return None
                quick[path] = f"{value!r} {unit}" if unit else value  # type: ignore[assignment]
            elif isinstance(value, str) and _QUANTITY.fullmatch(value):
                quick[path] = value
            else:
                return None
            changed = _with_leaf(tree, path.split("."), quick[path])
            if changed is None:
                return None
            tree = changed
        try:
            part = type(self._part).model_validate({"title": self.title, **tree})
            built = self._study.with_declaration(self.name, part)
        except (TradestudyError, ValueError):
            return None  # reported with its path by the study
        copy = object.__new__(Camera)
        copy.__dict__ |= {**self.__dict__, "_part": part, "_tree": tree, "_quick": quick, "_calibrated": built}
        copy.__dict__.pop("_depth", None)
        return copy

    def _changed(self, new_values: Mapping[str, Value]) -> PreparedStudy:
        """The study of the camera with all its changes."""
        study = self._study
        for values in (self._quick, new_values):
            if values:
                paths = {f"cameras.{self.name}.{path}": value for path, value in values.items()}
                study = study.with_values(paths, numbers_in_si=True)
        for path, value in new_values.items():
            entry = study.document.entry(f"cameras.{self.name}.{path}")
            if type(value) in (int, float) and isinstance(entry, ScalarEntry):
                _UNITS[type(study.file.cameras[self.name]), path] = entry.text.partition(" ")[2]
        return study

    @cached_property
    def _calibrated(self) -> in_si.Camera:
        """The camera in SI, with its calibration."""
        study, posteriors = self._study, self._origin.posteriors
        key = study.definition.posterior_keys.get(self.name)
        if key is None:
            return study.case.all_cameras[self.name]
        if key not in posteriors:
            from tradestudy.calibration.posteriors import infer

            posteriors[key] = infer(study.definition.calibrations_to_infer()[key]).calibration
        return replace(study, choices=Choices(posteriors={key: posteriors[key]})).case.all_cameras[self.name]

    @cached_property
    def _depth(self) -> DepthCamera:
        """The camera with the models of its study."""
        camera = self._calibrated
        if not isinstance(camera, DepthCamera):
            raise OutOfRangeError(f"the {self.kind} camera '{self.name}' measures no depth")
        return apply_models(camera, self._origin.models)

    def light_chain(self) -> MicrolensCamera:
        """A plenoptic camera in the form that `tradestudy.optics.microlens_image` expects.

        Raises
        ------
        OutOfRangeError
            If the camera has no microlens array.
        """
        return self._calibrated.light_chain()

    def refocusing(self, shifts: Any = None, blur: float = 1.0) -> xr.Dataset:
        """The planes on which an unfocused plenoptic camera refocuses, by the geometry of its design.

        Parameters
        ----------
        shifts
            Shifts between the views of neighbouring pixels [microlenses], any numbers; None for all distinct planes.
        blur
            Largest blur that counts as sharp, of a view and of a refocused picture [microlenses].

        Returns
        -------
        xarray.Dataset
            The variables of ``/refocusing`` over ``shift`` [m], and as attributes the range that can be refocused,
            ``near`` and ``far`` [m], and the number of distinct ``planes``.

        Raises
        ------
        OutOfRangeError
            For other kinds of cameras, and for shifts or a blur that the camera cannot have.
        """
        from tradestudy.answers.refocusing import refocused_planes

        return refocused_planes(self._calibrated.refocusing, shifts, blur)

    def triangulation(self, pixels: int, disparity: Any) -> xr.Dataset:
        """Distances that two views of an unfocused plenoptic camera measure, by the geometry of its design.

        Parameters
        ----------
        pixels
            Number of pixels from one view to the other under a microlens.
        disparity
            Disparities between the two views [microlenses], any numbers; 0 in focus, positive for nearer points.

        Returns
        -------
        xarray.Dataset
            ``distance``, ``from_pupil`` and ``from_array`` [m] over ``disparity``: where distances of the camera count
            from, from the entrance pupil, and from the array; infinite at and beyond infinity. The attribute
            ``baseline`` [m] is the distance of the views in the entrance pupil.

        Raises
        ------
        OutOfRangeError
            For other kinds of cameras, and for pairs or disparities that the camera cannot have.
        """
        from tradestudy.answers.refocusing import triangulated

        return triangulated(self._calibrated.refocusing, pixels, disparity)

    def depth_uncertainty(self, distance: Any, errors: ErrorSource = "both") -> xr.DataArray:
        """Half the central 68.27 % interval of the measured depth [m], whatever its bias.

        Parameters
        ----------
        distance
            True distances [m], any shape.
        errors
            Errors to include: ``"noise"``, ``"calibration"`` or ``"both"``.

        Returns
        -------
        xarray.DataArray
            Same shape. Infinite where the interval has no far end, NaN where the camera does not see the point.
        """
        return self._over("depth_uncertainty", distance, errors)

    def depth_error_radius(self, distance: Any, errors: ErrorSource = "both") -> xr.DataArray:
        """Radius about the true distance that contains 68.27 % of all measurements [m].

        The arguments are those of `depth_uncertainty`. Failures and false matches count as infinitely wrong.
        """
        return self._over("depth_error_radius", distance, errors)

    def failed_fraction(self, distance: Any, errors: ErrorSource = "both") -> xr.DataArray:
        """Fraction of measurements that end at or beyond infinity, or are false matches [1].

        The arguments are those of `depth_uncertainty`.
        """
        return self._over("failed_fraction", distance, errors)

    def quantiles(self, distance: Any, errors: ErrorSource = "both") -> xr.DataArray:
        """Quantiles of the measured depth [m].

        The arguments are those of `depth_uncertainty`. The last dimension, ``quantile``, has the probabilities: the
        median, and the ends of every interval that the study reports.
        """
        probabilities = list(self._depth.propagation.probabilities)
        return self._over("depth_quantile", distance, errors, quantile=probabilities)

    def parts(self, distance: Any) -> xr.DataArray:
        """Share of each part of the errors in the variance of inverse depth [1]; they sum to 1.

        The last dimension, ``part``, names the parts, such as ``noise``.
        """
        metres = in_metres(distance)
        shares = variance_shares(self._depth, imaged(self._depth, metres.ravel()))
        values = np.stack(list(shares.values()), axis=-1)
        return _labelled("variance_share", values, distance, metres, part=np.array(list(shares), dtype=object))

    def usable_range(self) -> xr.Dataset:
        """The intervals of distance in which the camera meets the limits of its study (key `usable_range`).

        Returns
        -------
        xarray.Dataset
            ``usable_near`` and ``usable_far`` [m], and ``near_limit`` and ``far_limit``, the names of the limits that
            set these ends, over ``interval``, from the nearest. They are sought within the distances of the scene.
        """
        import xarray as xr

        case = self._origin.study.case
        intervals = usable_intervals(self._depth, case.criteria, case.distance)
        columns: dict[str, list[Any]] = {
            "usable_near": [interval.near for interval in intervals],
            "usable_far": [interval.far for interval in intervals],
            "near_limit": [interval.near_limit for interval in intervals],
            "far_limit": [interval.far_limit for interval in intervals],
        }
        kinds = {name: object if "limit" in name else float for name in columns}
        return xr.Dataset(
            {
                name: ("interval", np.array(column, dtype=kinds[name]), _attributes(name))
                for name, column in columns.items()
            }
        )

    def _over(self, variable: str, distance: Any, errors: str, **last: Sequence[float]) -> xr.DataArray:
        """A variable of the distribution of depth at distances."""
        if errors not in ERROR_SOURCES:
            raise OutOfRangeError("errors", value=repr(errors), limit=", ".join(map(repr, ERROR_SOURCES)))
        metres = in_metres(distance)
        values = _of_distribution(variable, self._depth, metres.ravel(), errors)
        return _labelled(variable, values, distance, metres, **last)


_OF_DISTRIBUTION: Final = {
    "depth_uncertainty": "half_width",
    "depth_error_radius": "error_radius",
    "failed_fraction": "failed_fraction",
    "depth_quantile": "quantile",
}
"""Variables of ``/depth``, and what the distribution of depth calls them."""


def _of_distribution(variable: str, camera: DepthCamera, distance: FloatArray, errors: str) -> FloatArray:
    """A variable of one camera at distances [m] with an error source; the distance is the first dimension."""
    values: FloatArray = getattr(distribution(camera, imaged(camera, distance), errors), _OF_DISTRIBUTION[variable])
    return values.T


@cache
def _attributes(variable: str) -> Mapping[str, Any]:
    """Attributes of a variable of ``/depth``, as in results, but for the name of its error estimate."""
    dims = GROUPS["depth"][variable].dims
    attrs = dataset("depth", {variable: np.zeros((0,) * len(dims))}, {})[variable].attrs
    return {name: value for name, value in attrs.items() if name not in ("ancillary_variables", "error")}


def _labelled(variable: str, values: FloatArray, distance: Any, metres: FloatArray, **last: Any) -> xr.DataArray:
    """Values at flattened distances in the shape of the distances, followed by a named dimension with its labels."""
    import xarray as xr

    coordinates: dict[str, Any] = {}
    if isinstance(distance, xr.DataArray):
        dims = tuple(map(str, distance.dims))
        coordinates |= {str(key): value for key, value in distance.coords.items()}
    else:
        dims = ("distance",) if metres.ndim == 1 else tuple(f"distance_{k}" for k in range(metres.ndim))
    coordinates["distance"] = (dims, metres, DISTANCE)
    return xr.DataArray(
        values.reshape((*metres.shape, *values.shape[1:])),
        dims=(*dims, *last),
        coords=coordinates | last,
        attrs=dict(_attributes(variable)),
        name=variable,
    )


def _leaf(tree: Any, steps: list[str]) -> Any:
    """What a nested dictionary has at the end of some steps; None if nothing."""
    return functools.reduce(lambda above, step: above.get(step) if isinstance(above, dict) else None, steps, tree)


def _with_leaf(tree: Mapping[str, Any], steps: list[str], value: str | float) -> dict[str, Any] | None:
    """A nested dictionary with another single value; None if something else has its place, or the part above."""
    step, *rest = steps
    old = tree.get(step)
    if not rest:
        return None if isinstance(old, dict | list) else {**tree, step: value}
    below = _with_leaf(old, rest, value) if isinstance(old, dict) else None
    return None if below is None else {**tree, step: below}


class Cameras(Mapping[str, Camera]):
    """The cameras of a study by name, in its order."""

    def __init__(self, study: PreparedStudy) -> None:
        self._study = study
        self._known: dict[str, Camera] = {}

    def __getitem__(self, name: str) -> Camera:
        names = list(self._study.file.cameras)
        if name not in names:
            close = nearest(str(name), names)
            raise UnknownNameError(
                "no camera of the study has this name",
                value=repr(name),
                limit=", ".join(map(repr, names)) or "none, because the study has no cameras",
                remedy="" if close is None else f"nearest: {close!r}",
            )
        if name not in self._known:
            self._known[name] = Camera(_Origin(self._study, name), self._study)
        return self._known[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._study.file.cameras)

    def __len__(self) -> int:
        return len(self._study.file.cameras)

    def __repr__(self) -> str:
        return f"<Cameras {', '.join(self)}>"


def sweep(study: PreparedStudy, values: Mapping[str, Any], what: str | Sequence[str]) -> xr.Dataset:
    """Compute some variables of ``/depth`` for every combination of values; see `Study.sweep`."""
    import xarray as xr

    from tradestudy.answers.calibration import infer_calibrations
    from tradestudy.answers.depth import depth_coordinates
    from tradestudy.execution import Steps
    from tradestudy.models.choice import choose_depth_models

    names = _variables(what)
    if not study.case.cameras:
        raise OutOfRangeError("a sweep of depth", value="no camera", limit="studies with cameras that measure depth")
    others = [key for key in _OTHER_QUESTIONS if study.document.entry((key,)) is not None]
    swept_values = {path: _several(study, path, plain_value(several)) for path, several in values.items()}
    with_sweep = study.with_values(dict.fromkeys(others)).with_values({"sweep": swept_values}, numbers_in_si=True)
    axes = tuple(_as_asked(axis, with_sweep.document.tree["sweep"][axis.path]) for axis in sweep_axes(with_sweep))
    chosen = replace(with_sweep, choices=Choices(models=choose_depth_models(with_sweep, with_sweep.case.cameras)))
    designs = sweep_points(infer_calibrations(chosen, Steps())[0], axes)
    distance = study.case.distance
    cameras = [(camera, design.case.criteria) for design in designs for camera in design.case.cameras.values()]
    numbers = {camera: number for number, camera in enumerate(dict.fromkeys(cameras))}
    arrays, parts = _swept_arrays(names, list(numbers), distance)
    labels = dict(zip(coordinate_names([axis.path for axis in axes]), axes, strict=True))
    shape, places = tuple(len(axis.labels) for axis in axes), [numbers[camera] for camera in cameras]
    variables: dict[str, Any] = {}
    for name in names:
        dims = [dim for dim in GROUPS["depth"][name].dims if dim != "error_source" or name not in _QUICK]
        array = arrays[name][places].reshape((*shape, -1, *arrays[name].shape[1:]))
        variables[name] = ((*labels, *dims), array, dict(_attributes(name)))
    swept = xr.Dataset(variables)
    coordinates: dict[str, Any] = {
        name: (name, np.array(column, dtype=object if isinstance(column[0], str) else None))
        for name, column in depth_coordinates(study, distance, parts).items()
        if name in swept.dims
    }
    for name, axis in labels.items():
        attrs = {"units": axis.units, "long_name": name.replace("_", " "), "path": axis.path}
        coordinates[name] = (name, np.array(axis.labels, dtype=None if axis.dimension else object), attrs)
    if "distance" in coordinates:
        coordinates["distance"] = ("distance", distance, DISTANCE)
    return swept.assign_coords(coordinates)


_OTHER_QUESTIONS: Final = ("sweep", "readings", "solve", "claims", "value_of_information")
"""Keys of a study that would have models examined at other values than those of a sweep."""

_MEANT: Final = {
    "depth": ("depth_uncertainty", "depth_quantile"),  # what the distribution of depth gives at once
    "uncertainty": ("depth_uncertainty",),
    "error_radius": ("depth_error_radius",),
    "quantiles": ("depth_quantile",),
    "usable_range": ("usable_near", "usable_far"),
}
"""Names for variables in a sweep, beside their own."""
_QUICK: Final = (*_OF_DISTRIBUTION, "relative_uncertainty", "usable")
"""Variables that need no complete table of depth."""


def _swept_arrays(
    names: Sequence[str], cameras: Sequence[tuple[DepthCamera, UsableCriteria]], distance: FloatArray
) -> tuple[dict[str, Any], list[str]]:
    """Variables with the camera as first dimension, the quick ones for all errors together; and the parts of errors."""
    from tradestudy.answers.depth import DepthPoint, depth_arrays, depth_table

    arrays: dict[str, Any] = {}
    parts: list[str] = []
    if not set(names) <= set(_QUICK):
        points = [DepthPoint(camera=camera, criteria=criteria, distance=distance) for camera, criteria in cameras]
        arrays, parts = depth_arrays([depth_table(point) for point in points])
    quick = {name: np.stack([_quick(name, *pair, distance) for pair in cameras]) for name in names if name in _QUICK}
    return arrays | quick, parts


def _quick(
    variable: str, camera: DepthCamera, criteria: UsableCriteria, distance: FloatArray
) -> FloatArray | BoolArray:
    """A variable of one camera of a sweep, for all errors together."""
    if variable == "usable":
        return all_met(evaluate_limits(camera, criteria, distance, depth=distribution), distance.shape)
    if variable == "relative_uncertainty":
        return _of_distribution("depth_uncertainty", camera, distance, "both") / distance
    return _of_distribution(variable, camera, distance, "both")


def _variables(what: str | Sequence[str]) -> tuple[str, ...]:
    """The variables that a sweep computes."""
    variables: list[str] = []
    for name in (what,) if isinstance(what, str) else what:
        spelled = str(name).replace(" ", "_")
        if spelled not in _MEANT and spelled not in GROUPS["depth"]:
            close = nearest(spelled, [*_MEANT, *GROUPS["depth"]])
            raise UnknownNameError(
                "what a sweep computes",
                value=repr(name),
                limit=f"{', '.join(map(repr, (*_MEANT, *_QUICK)))} and the other variables of /depth",
                remedy="" if close is None else f"nearest: {close!r}",
            )
        variables += _MEANT.get(spelled, (spelled,))
    if not variables:
        raise OutOfRangeError("what a sweep computes", value=repr(what), limit="at least one variable of /depth")
    return tuple(dict.fromkeys(variables))


def _several(study: PreparedStudy, path: str, values: Value) -> Value:
    """The values of one swept parameter, of which the first is possible."""
    if not isinstance(values, list) or not values:
        raise OutOfRangeError(
            f"{path}: the swept values", value=f"{values!r:.60}", limit="a list or an array with at least one value"
        )
    if values[0] is not None:
        study.with_values({path: values[0]}, numbers_in_si=True)
    return values


def _as_asked(axis: SweepAxis, values: Sequence[Value]) -> SweepAxis:
    """An axis with the given values alone, in their order, without the declared one."""
    dimension = axis.dimension
    labels = [scalar_text(cast(Scalar, value)) if dimension is None else parse(value, dimension) for value in values]
    entries = dict(zip(axis.labels, axis.values, strict=True))
    return replace(
        axis, labels=cast(tuple[float, ...], tuple(labels)), values=tuple(entries[label] for label in labels)
    )
