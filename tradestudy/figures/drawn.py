"""The figures of a results tree, drawn: here, or by a second interpreter while this one does something else."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import IO, TYPE_CHECKING, Final

if TYPE_CHECKING:
    import xarray as xr

    from tradestudy.figures.drawing import Drawing, Plotted

# The second interpreter finds what this one finds, wherever it is started.
_CODE: Final = "import sys; sys.path[:] = sys.argv[1:]; from tradestudy.figures.drawn import serve; serve()"


def drawn_here(drawings: Mapping[str, Drawing]) -> Mapping[str, Plotted]:
    """Draw figures, by name."""
    from tradestudy.figures.plotted import plotted

    return {name: plotted(drawing.draw()) for name, drawing in drawings.items()}


@dataclass(frozen=True)
class Drawer:
    """A second interpreter that draws the figures of results from the moment that they are there; the same bytes."""

    tasks: IO[bytes]
    answers: IO[bytes]

    def begin(self, tree: xr.DataTree) -> None:
        """Hand the results over."""
        with suppress(OSError):  # it has died: `pictures` will see
            pickle.dump(tree, self.tasks, protocol=pickle.HIGHEST_PROTOCOL)
            self.tasks.flush()

    def pictures(self, drawings: Mapping[str, Drawing]) -> Mapping[str, Plotted]:
        """Take the drawn figures, by name; what is missing, as all are where it failed, is drawn here."""
        found: Mapping[str, Plotted] = {}
        with suppress(EOFError, OSError, pickle.UnpicklingError):
            found = pickle.load(self.answers)
        return {**found, **drawn_here({name: one for name, one in drawings.items() if name not in found})}


@contextmanager
def drawer() -> Iterator[Drawer]:
    """Start a second interpreter, which loads what drawing takes and waits for results; at the end it is stopped.

    It is no process of `multiprocessing`, which would run the script of a user again that does not ask for
    ``__name__ == "__main__"``.
    """
    process = subprocess.Popen(
        [sys.executable, "-P", "-c", _CODE, *sys.path],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    try:
        yield Drawer(process.stdin, process.stdout)
    finally:
        process.kill()
        with suppress(OSError):  # what it did not take any more
            process.stdin.close()
        process.stdout.close()
        process.wait()


def serve() -> None:
    """What the second interpreter does: take the results, draw their figures, give them back."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends Ctrl-C to all; the run ends this process itself
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # whatever else is printed is no answer
    from tradestudy.figures.gallery import all_drawings
    from tradestudy.figures.style import new_figure

    new_figure(1.0).svg()  # loads what matplotlib loads with the first figure
    gc.freeze()  # what is loaded stays: nobody need look through it again and again
    with suppress(EOFError):  # the run has ended before its figures
        pictures = drawn_here(all_drawings(pickle.load(sys.stdin.buffer)))
        with answers:
            pickle.dump(pictures, answers, protocol=pickle.HIGHEST_PROTOCOL)
