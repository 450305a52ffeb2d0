"""Depth of field, resolution and number of images of lenses."""

from tradestudy.cameras.focus.every_object import EveryObjectFocus
from tradestudy.cameras.focus.focus import BlurCriterion, Focus, SharpRange
from tradestudy.cameras.focus.single_lens import SingleLensFocus

__all__ = [
    "BlurCriterion",
    "EveryObjectFocus",
    "Focus",
    "SharpRange",
    "SingleLensFocus",
]
