"""The steps by which planes were found as regions: a noun of its own, as only pictures of them ask for it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Segmentation:
    """How image 1 was divided into planes, for pictures of the steps; all (h, w), of a working image, maybe smaller.

    gradient : float32, grey levels per px.  threshold : of the gradient, below which a pixel is inside a surface.
    components : int32, connected regions below the threshold, 1 the largest, 0 for none.
    merged : int32, the same after neighbours that one plane transfers were merged, 1..k.
    """

    gradient: NDArray[np.float32]
    threshold: float
    components: NDArray[np.int32]
    merged: NDArray[np.int32]
