"""The wave behind a lens on the nodes of its disc."""

from __future__ import annotations

import numpy as np

from tradestudy.optics.propagation.direct import ApertureSamples, Kernel
from tradestudy.optics.propagation.lens import LensWave
from tradestudy.optics.propagation.sampling import NodeCounts, needed_nodes, outline
from tradestudy.optics.propagation.targets import Targets
from tradestudy.optics.propagation.wave_optics import FieldAccuracy
from tradestudy.optics.quadrature import disc_nodes


def sample_wave(wave: LensWave, counts: NodeCounts) -> ApertureSamples:
    """Sample the wave behind a lens on the nodes of its disc."""
    lens = wave.lens
    nodes = disc_nodes(radius=lens.radius, radial_count=counts.radial, angular_count=counts.angular, centre=lens.centre)
    x, y = nodes.x - lens.centre[0], nodes.y - lens.centre[1]
    cosine = None if wave.paraxial or wave.obliquity != "textbook" else wave.axial_cosine(x, y)
    return ApertureSamples(nodes=nodes, field=np.asarray(wave.field(x, y), dtype=np.complex128), axial_cosine=cosine)


def nodes_for(wave: LensWave, kernel: Kernel, targets: Targets, accuracy: FieldAccuracy) -> NodeCounts:
    """Node counts for the wave behind a lens and the outline of the targets."""
    x, y, z = targets.coordinates()
    x, y, z = outline(x - wave.lens.centre[0], y - wave.lens.centre[1], z)
    return needed_nodes(
        wave.paths,
        kernel,
        radius=wave.lens.radius,
        x=x,
        y=y,
        z=z,
        tolerance=1e-3 * accuracy.tolerance,
    )
