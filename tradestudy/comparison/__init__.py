"""Compare finished runs: conclusions that changed, inputs that differ, results that changed."""

from __future__ import annotations

from tradestudy.comparison.comparing import compare_runs
from tradestudy.comparison.comparison import Comparison
from tradestudy.comparison.difference import Difference

__all__ = ["Comparison", "Difference", "compare_runs"]
