"""What lenses keep in focus, at which resolution, and with how many images."""

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
