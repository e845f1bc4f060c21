"""Loaded before any test module, and so before numpy and OpenCV, which read these once.

The tests themselves are what runs in parallel (`make test`); a pool of threads in each of them would only be in the way
of the others. The program declines those of OpenBLAS in any case. Tests in which the number of threads matters set it.
"""

from __future__ import annotations

import os

for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"):
    os.environ.setdefault(name, "1")
