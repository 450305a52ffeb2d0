"""The figures and the file of a results tree, made here or by a second interpreter, which begins earlier."""

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

# The second interpreter finds what this one finds, wherever it is started, except dask: xarray would load it, for half
# a second, only to ask whether arrays are of its kind.
_CODE: Final = (
    "import sys; sys.path[:] = sys.argv[1:]; sys.modules['dask'] = None; "
    "from tradestudy.figures.drawn import serve; serve()"
)


def drawn_here(drawings: Mapping[str, Drawing]) -> Mapping[str, Plotted]:
    """Draw figures, by name."""
    from tradestudy.figures.plotted import plotted

    return {name: plotted(drawing.draw()) for name, drawing in drawings.items()}


@dataclass(frozen=True)
class Drawer:
    """A second interpreter that writes the file of results and draws their figures; the same bytes."""

    tasks: IO[bytes]
    answers: IO[bytes]

    def begin(self, tree: xr.DataTree, *, filed: bool = False) -> SharedDrawing:
        """Hand the results over; from now on, their figures are drawn, after their file if it is asked for."""
        return SharedDrawing(self, tree, filed=filed)


class SharedDrawing:
    """Figures that a second interpreter draws from the first on, and this one, once asked for them, from the last.

    `asking` is the thread that has the other draw; it ends when no figure is left or the other has died.
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
        """Take the content of ``results.nc``, which is written here if the other interpreter has died."""
        try:
            return self._file.result()
        except CancelledError:
            return storage.encoded(self._tree)

    def pictures(self, drawings: Mapping[str, Drawing]) -> Mapping[str, Plotted]:
        """Take the drawn figures, by name; what the other interpreter has not begun, or not finished, is drawn here."""
        self._listed.wait()
        for name in _taken(self._left.pop):
            self._drawn |= drawn_here({name: drawings[name]})
        self.asking.join()
        found = self._drawn
        return {name: found[name] if name in found else drawn_here({name: one})[name] for name, one in drawings.items()}

    def _ask(self, results: bytes, *, filed: bool) -> None:
        tasks, answers = self._drawer.tasks, self._drawer.answers
        try:
            # It has died, or the run has ended and closed the pipes.
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
    """Take one after the other until there is none."""
    with suppress(IndexError):
        while True:
            yield take()


def _send(pickled: bytes, pipe: IO[bytes]) -> None:
    pipe.write(pickled)
    pipe.flush()


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
        with suppress(OSError):  # what it no longer accepted
            process.stdin.close()
        process.stdout.close()
        process.wait()


def serve() -> None:
    """What the second interpreter does: take results, list their figures, make what it is asked for."""
    gc.set_threshold(20_000, 20, 20)  # as the program itself does
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends Ctrl-C to all; the run ends this process itself
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # anything else printed is not an answer
    import xarray as xr

    from tradestudy.figures.gallery import all_drawings
    from tradestudy.figures.style import new_figure

    # The libraries load more with their first use, before there are results.
    first = new_figure(1.0)
    first.subplots()
    first.svg()
    one = xr.DataArray([0.0], {"place": [0.0]}, name="one")
    one.sel(place=0.0)
    storage.encoded(xr.DataTree(one.to_dataset()))
    gc.freeze()  # what is loaded stays: nobody need look through it again and again
    with suppress(EOFError), answers:  # the run takes no more
        tree = pickle.load(sys.stdin.buffer)
        drawings = all_drawings(tree)
        _send(pickle.dumps(list(drawings)), answers)
        while True:
            name = pickle.load(sys.stdin.buffer)
            made = storage.encoded(tree) if name == storage.RESULTS else drawn_here({name: drawings[name]})[name]
            _send(pickle.dumps(made, protocol=pickle.HIGHEST_PROTOCOL), answers)
