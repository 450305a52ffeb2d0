"""What holds for every test."""

from __future__ import annotations

import os

# Read when numpy loads. The matrices of the tests are small: threads that wait for each other on busy cores cost more
# than they give.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
