"""How many microlenses see a point, and how long a baseline they offer: exact geometry on the lattice."""

from tradestudy.optics.microlens_coverage.equivalent_baseline import (
    EquivalentBaseline,
    least_squares_baseline,
    widest_pair_baseline,
)
from tradestudy.optics.microlens_coverage.lattice import Counting, Layout
from tradestudy.optics.microlens_coverage.pair_lengths import PairLengths, least_squares_pairs
from tradestudy.optics.microlens_coverage.seen_count import (
    covering_microlens_object_distance,
    covering_radius_over_pitch,
    mean_seen_count,
    projected_radius_over_pitch,
    seen_count_probability,
)

__all__ = [
    "Counting",
    "EquivalentBaseline",
    "Layout",
    "PairLengths",
    "covering_microlens_object_distance",
    "covering_radius_over_pitch",
    "least_squares_baseline",
    "least_squares_pairs",
    "mean_seen_count",
    "projected_radius_over_pitch",
    "seen_count_probability",
    "widest_pair_baseline",
]
