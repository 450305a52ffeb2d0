"""What each kind of camera keeps in focus, near and far, in closed form."""

from tradestudy.optics.depth_of_field.focus_stack import (
    FocusStack,
    IntervalUnion,
    focus_stack,
    images_needed,
    plan_focus_stack,
    union,
)
from tradestudy.optics.depth_of_field.microlens_relay import (
    inverse_focus_virtual_depth,
    microlens_focal_length,
    relay_blur_diameter,
    relay_depth_of_field,
    touching_inverse_virtual_depths,
    virtual_depth_limits,
)
from tradestudy.optics.depth_of_field.single_lens import (
    BlurAllowance,
    DepthOfField,
    DiffractionMeasure,
    blur_allowance,
    depth_of_field,
    diffraction_diameter,
    diffraction_inclusive_depth_of_field,
    hyperfocal_distance,
    intersection,
    object_distance_of_magnification,
    object_distance_of_working_distance,
)
from tradestudy.optics.depth_of_field.unfocused_plenoptic import (
    refocus_distance,
    refocused_depth_of_field,
    view_depth_of_field,
    view_pupil_diameter,
)

__all__ = [
    "BlurAllowance",
    "DepthOfField",
    "DiffractionMeasure",
    "FocusStack",
    "IntervalUnion",
    "blur_allowance",
    "depth_of_field",
    "diffraction_diameter",
    "diffraction_inclusive_depth_of_field",
    "focus_stack",
    "hyperfocal_distance",
    "images_needed",
    "intersection",
    "inverse_focus_virtual_depth",
    "microlens_focal_length",
    "object_distance_of_magnification",
    "object_distance_of_working_distance",
    "plan_focus_stack",
    "refocus_distance",
    "refocused_depth_of_field",
    "relay_blur_diameter",
    "relay_depth_of_field",
    "touching_inverse_virtual_depths",
    "union",
    "view_depth_of_field",
    "view_pupil_diameter",
    "virtual_depth_limits",
]
