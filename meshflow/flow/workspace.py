"""Arrays that steps write to and return for reuse: a run needs two or three, whatever its number of steps."""

import numpy as np

from meshflow.flow.contract import Flow
from meshflow.geometry.validation import Array

__all__ = ["Workspace"]


class Workspace:
    """Arrays (n, k) in the number type and the memory layout of the states of a flow.

    Each run makes one; its memory is freed with the run.

    :param flow: the flow.
    """

    def __init__(self, flow: Flow) -> None:
        self._like = flow.start()
        self._free: list[Array] = []

    def take(self) -> Array:
        """An array (n, k) to write to, with undefined contents."""
        return self._free.pop() if self._free else np.empty_like(self._like)

    def give(self, *arrays: Array) -> None:
        """Return arrays that are no longer needed, for reuse by :meth:`take`."""
        self._free.extend(arrays)
