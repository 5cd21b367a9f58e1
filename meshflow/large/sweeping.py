"""Runs the windows of a grid for what is asked of all of them together, from one state in files to the next."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

from meshflow.estimate.plan import Plan
from meshflow.estimate.request import Request
from meshflow.large.between import Between
from meshflow.large.legs import Leg
from meshflow.large.memory import Budget
from meshflow.large.sample import part_of
from meshflow.large.source import Source, Window, grown, tiled
from meshflow.large.windows import Begun, Bound
from meshflow.results.stretches import Seen

__all__ = ["Swept"]

# Makes what is told of each step of the plan of a window, which lies at a window of it.
W = TypeVar("W", bound=Callable[[Plan, Window], Seen])


@dataclass(frozen=True, eq=False)
class Swept:
    """A grid whose windows are run.

    :ivar bound: what every window runs.
    """

    bound: Bound
    grid: Source
    request: Request
    budget: Budget

    def by(self, leg: Leg, states: tuple[Between, Between], watch: Callable[[], W]) -> Iterator[tuple[W, float]]:
        """What was told of each window in a leg, and the share of the windows that is done.

        :param states: that before the leg, and the one that takes that after it.
        :param watch: makes one for each window.
        """
        form, (old, new) = self.grid.form, states
        windows = list(tiled(form.shape, self.budget.sides(form, leg.halo, leg.held)))
        for i, inner in enumerate(windows):
            outer = grown(inner, leg.halo, form.shape)
            held, watching = part_of(self.request.constraints, form.shape, outer), watch()
            state = self.bound.held((inner, outer), *self.grid.read(outer), held, Begun(leg, old.read(outer)), watching)
            new.write(inner, state if leg.held else {})
            yield watching, (i + 1) / len(windows)
