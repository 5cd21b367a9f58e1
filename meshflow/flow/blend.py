"""What a stage of a stepper needs in addition to the rate, so that an engine computes all of it in one pass."""

from dataclasses import dataclass

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["RATE", "Blend", "euler"]


@dataclass(frozen=True, eq=False)
class Blend:
    """keep u + dt rate(u) + the sum of c (a - u) over ``toward`` + c a of ``drift``.

    The rate alone is keep = 0, dt = 1 (:data:`RATE`); an explicit step of Euler keep = 1 (:func:`euler`); a stage of
    super-time-stepping moves toward earlier stages and adds the rate at its start.

    :param keep: factor of u.
    :param dt: factor of the rate.
    :param toward: at most two pairs (c, a), a (n, k).
    :param drift: (c, a), a (n, k).
    """

    keep: float = 0.0
    dt: float = 1.0
    toward: tuple[tuple[float, Array], ...] = ()
    drift: tuple[float, Array] | None = None

    @property
    def bare(self) -> "Blend":
        """The same without ``toward`` and ``drift``."""
        return Blend(self.keep, self.dt)

    @property
    def is_bare(self) -> bool:
        """Whether only u and the rate are needed."""
        return not self.toward and self.drift is None

    def of_rate(self, u: Array, rate: Array, out: Array | None = None) -> Array:
        """The blend (n, k) where the rate is known; ``rate`` is overwritten.

        :param out: where to write; by default over ``rate``.
        """
        if self.dt != 1.0:
            rate *= self.dt
        return self.of_change(u, rate, out)

    def of_change(self, u: Array, change: Array, out: Array | None = None) -> Array:
        """The blend (n, k) where dt rate(u) is known; ``change`` is overwritten.

        :param out: where to write; by default over ``change``.
        """
        for c, a in self.toward:
            change += c * (a - u)
        if self.drift is not None:
            change += self.drift[0] * self.drift[1]
        if self.keep != 0.0:
            kept = u if self.keep == 1.0 else self.keep * u
            return np.add(kept, change, out=change if out is None else out)
        if out is None:
            return change
        out[...] = change
        return out


# The rate alone.
RATE = Blend()


def euler(dt: float) -> Blend:
    """u + dt rate(u)."""
    return Blend(1.0, dt)
