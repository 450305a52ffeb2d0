"""What each kind of camera keeps in focus, at which resolution, and with how many images."""

from tradestudy.cameras.focus.every_object import EveryObjectFocus
from tradestudy.cameras.focus.focus import BlurCriterion, Focus, SharpRange
from tradestudy.cameras.focus.image_stack import ImageStackFocus
from tradestudy.cameras.focus.microlens_types import MicrolensTypesFocus
from tradestudy.cameras.focus.refocused_views import RefocusedViewsFocus
from tradestudy.cameras.focus.single_lens import SingleLensFocus

__all__ = [
    "BlurCriterion",
    "EveryObjectFocus",
    "Focus",
    "ImageStackFocus",
    "MicrolensTypesFocus",
    "RefocusedViewsFocus",
    "SharpRange",
    "SingleLensFocus",
]
