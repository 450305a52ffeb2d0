"""What holds for every test."""

from __future__ import annotations

import os
import sys

# Read when numpy loads. The matrices of the tests are small: threads that wait for each other on busy cores cost more
# than they give.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Many tests start the program in a process of its own; it is compiled once for all of them, whatever the shell says.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
