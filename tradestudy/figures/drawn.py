"""Draw the figures of a results tree, here or, in part, in a second interpreter that starts early."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from threading import Thread
from typing import IO, TYPE_CHECKING, Final

from tradestudy.figures.drawing import Drawing, Plotted

if TYPE_CHECKING:
    import xarray as xr

# The second interpreter imports from the same places as this one. It does not see dask: xarray would spend half a
# second on loading dask, only to check whether an array is a dask array.
_CODE: Final = (
    "import sys; sys.path[:] = sys.argv[1:]; sys.modules['dask'] = None; "
    "from tradestudy.figures.drawn import serve; serve()"
)


def drawn_here(
    drawings: Mapping[str, Drawing], progress: Callable[[float], None] = lambda _share: None
) -> Mapping[str, Plotted]:
    """Draw figures in this interpreter; they keep their names."""
    from tradestudy.figures.plotted import plotted

    found = {}
    for name, drawing in drawings.items():
        found[name] = plotted(drawing.draw())
        progress(len(found) / len(drawings))
    return found


@dataclass(frozen=True)
class Drawer:
    """A second interpreter, which draws the figures of results with the same bytes as this one."""

    tasks: IO[bytes]
    answers: IO[bytes]

    def begin(self, tree: xr.DataTree) -> SharedDrawing:
        """Hand results over: the second interpreter starts to draw their figures."""
        return SharedDrawing(self, pickle.dumps(tree, protocol=pickle.HIGHEST_PROTOCOL))


class SharedDrawing:
    """Figures that two interpreters draw: the second one from the first figure on, this one, when asked, from the last.

    The thread `receiving` ends when the second interpreter has drawn all figures or died.
    """

    def __init__(self, drawer: Drawer, results: bytes) -> None:
        self._drawn: dict[str, Plotted] = {}
        self.receiving = Thread(target=self._receive, args=(drawer, [results]), daemon=True)
        self.receiving.start()

    def _receive(self, drawer: Drawer, results: list[bytes]) -> None:
        # The second interpreter may have died, or the run may have ended and closed the pipes.
        with suppress(EOFError, OSError, ValueError, pickle.UnpicklingError):
            drawer.tasks.write(results.pop())  # and forget them: those of a large sweep take hundreds of megabytes
            drawer.tasks.flush()
            while True:
                self._drawn |= pickle.load(drawer.answers)

    def pictures(
        self, drawings: Mapping[str, Drawing], progress: Callable[[float], None] = lambda _share: None
    ) -> Mapping[str, Plotted]:
        """Take the drawn figures, by name; those that the second interpreter has not finished are drawn here.

        This interpreter waits for none: where both cores are busy, the other one may take long. So at most one figure
        is drawn twice.
        """
        for name in reversed(list(drawings)):
            if name not in self._drawn:
                self._drawn |= drawn_here({name: drawings[name]})
            progress(len(self._drawn) / len(drawings))  # of both interpreters
        return {name: self._drawn[name] for name in drawings}


@contextmanager
def drawer() -> Iterator[Drawer]:
    """Start a second interpreter, which loads the libraries for drawing and waits for results; stop it at the end.

    It is not a process of `multiprocessing`, which would run a user's script a second time if that lacks the guard
    ``if __name__ == "__main__"``.
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
        with suppress(OSError):  # data that the dead interpreter did not accept
            process.stdin.close()
        process.stdout.close()
        process.wait()


def serve() -> None:
    """Run the second interpreter: receive results, and send their figures one after the other."""
    gc.set_threshold(20_000, 20, 20)  # as the program itself does
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches both processes; the run ends this one
    if sys.platform != "win32":
        os.nice(10)  # it helps where a core is idle, and should slow nobody else
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # anything that libraries print must not look like an answer
    import xarray as xr

    from tradestudy.figures.gallery import all_drawings
    from tradestudy.figures.style import new_figure

    # Libraries load more modules when first used; do that before there are results.
    first = new_figure(1.0)
    first.subplots()
    first.svg()
    xr.DataArray([0.0], {"place": [0.0]}).sel(place=0.0)
    gc.freeze()  # exempt loaded modules from garbage collection: they stay anyway
    with suppress(EOFError, BrokenPipeError), answers:  # the run has ended
        for name, drawing in all_drawings(pickle.load(sys.stdin.buffer)).items():
            pickle.dump(drawn_here({name: drawing}), answers, protocol=pickle.HIGHEST_PROTOCOL)
            answers.flush()
