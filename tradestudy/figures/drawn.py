"""Draw the figures and encode the file of a results tree, here or in a second interpreter that starts early."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from threading import Event, Thread
from typing import IO, TYPE_CHECKING, Final

from tradestudy.figures.drawing import Drawing, Plotted
from tradestudy.results import storage

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
    """A second interpreter, which encodes results as a file and draws their figures with the same bytes as this one."""

    tasks: IO[bytes]
    answers: IO[bytes]

    def begin(self, tree: xr.DataTree, *, filed: bool = False) -> SharedDrawing:
        """Hand the results over: the second interpreter starts to draw their figures, after the file if `filed`."""
        return SharedDrawing(self, tree, filed=filed)


class SharedDrawing:
    """Figures that two interpreters draw: the second one from the first figure on, this one, when asked, from the last.

    The thread `asking` gives figures to the second interpreter; it ends when none is left or that interpreter has died.
    """

    def __init__(self, drawer: Drawer, tree: xr.DataTree, *, filed: bool) -> None:
        self._drawer, self._tree = drawer, tree
        self._file = Future[bytes]()
        self._left = deque[str]()  # names of figures that nobody has begun
        self._listed = Event()
        self._drawn: dict[str, Plotted] = {}
        results = pickle.dumps(tree, protocol=pickle.HIGHEST_PROTOCOL)
        self.asking = Thread(target=self._ask, args=(results,), kwargs={"filed": filed}, daemon=True)
        self.asking.start()

    def file(self) -> bytes:
        """Take the content of ``results.nc``, encoded here if the second interpreter has died."""
        try:
            return self._file.result()
        except CancelledError:
            return storage.encoded(self._tree)

    def pictures(
        self, drawings: Mapping[str, Drawing], progress: Callable[[float], None] = lambda _share: None
    ) -> Mapping[str, Plotted]:
        """Take the drawn figures, by name; those that the second interpreter has not finished are drawn here."""
        self._listed.wait()
        for name in _taken(self._left.pop):
            self._drawn |= drawn_here({name: drawings[name]})
            progress(len(self._drawn) / len(drawings))  # of both interpreters
        self.asking.join()
        found = self._drawn
        return {name: found[name] if name in found else drawn_here({name: one})[name] for name, one in drawings.items()}

    def _ask(self, results: bytes, *, filed: bool) -> None:
        tasks, answers = self._drawer.tasks, self._drawer.answers
        try:
            # The second interpreter may have died, or the run may have ended and closed the pipes.
            with suppress(EOFError, OSError, ValueError, pickle.UnpicklingError):
                _send(results, tasks)
                self._left.extend(pickle.load(answers))
                self._listed.set()
                if filed:
                    _send(pickle.dumps(storage.RESULTS), tasks)
                    self._file.set_result(pickle.load(answers))
                for name in _taken(self._left.popleft):
                    _send(pickle.dumps(name), tasks)
                    self._drawn[name] = pickle.load(answers)
        finally:
            self._listed.set()
            self._file.cancel()


def _taken(take: Callable[[], str]) -> Iterator[str]:
    """Take names, one after the other, until none is left."""
    with suppress(IndexError):
        while True:
            yield take()


def _send(pickled: bytes, pipe: IO[bytes]) -> None:
    pipe.write(pickled)
    pipe.flush()


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
    """Run the second interpreter: receive results, list their figures, and make the figures and files asked for."""
    gc.set_threshold(20_000, 20, 20)  # as the program itself does
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches both processes; the run ends this one
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # anything that libraries print must not look like an answer
    import xarray as xr

    from tradestudy.figures.gallery import all_drawings
    from tradestudy.figures.style import new_figure

    # Libraries load more modules when first used; do that before there are results.
    first = new_figure(1.0)
    first.subplots()
    first.svg()
    one = xr.DataArray([0.0], {"place": [0.0]}, name="one")
    one.sel(place=0.0)
    storage.encoded(xr.DataTree(one.to_dataset()))
    gc.freeze()  # exempt loaded modules from garbage collection: they stay anyway
    with suppress(EOFError), answers:  # the run has closed the pipes
        tree = pickle.load(sys.stdin.buffer)
        drawings = all_drawings(tree)
        _send(pickle.dumps(list(drawings)), answers)
        while True:
            name = pickle.load(sys.stdin.buffer)
            made = storage.encoded(tree) if name == storage.RESULTS else drawn_here({name: drawings[name]})[name]
            _send(pickle.dumps(made, protocol=pickle.HIGHEST_PROTOCOL), answers)
