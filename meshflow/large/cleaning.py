"""The count of a grid without its outliers, which are told by a rule found on the sample."""

from collections.abc import Callable
from dataclasses import dataclass

from meshflow.estimate.constraints import Constraints
from meshflow.geometry.validation import Array
from meshflow.large.census import AT_ONCE, Census, census_of
from meshflow.large.sample import part_of
from meshflow.large.source import Form, Source, Window, grown, within
from meshflow.large.windows import Bound, Local

__all__ = ["bound_over"]


@dataclass(frozen=True, eq=False)
class Cleaned:
    """A grid without its outliers.

    :ivar constraints: of the grid: what they fix is not replaced.
    """

    source: Source
    local: Local
    constraints: Constraints

    @property
    def form(self) -> Form:
        """That of the grid."""
        return self.source.form

    def read(self, window: Window) -> tuple[Array, Array]:
        """Values (r, c) or (r, c, k) of a window, and those (r, c) that are missing."""
        shape = self.form.shape
        outer = grown(window, self.local.reach, shape)
        held, at = part_of(self.constraints, shape, outer), within(window, outer)
        values, missing = self.local.cleaned(*self.source.read(outer), outer[0], held)
        return values[at], missing[at]


def bound_over(
    local: Local,
    source: Source,
    constraints: Constraints,
    census: Census | None = None,
    report: Callable[[float], object] | None = None,
    at_once: int = AT_ONCE,
) -> Bound:
    """What every window of a grid runs: with the count of the whole, without its outliers where they are not taken as data.

    Its parameters are those of the count, hence their number.

    :param constraints: of the whole.
    :param census: the count with outliers, where it is known.
    :param report: takes the share done; ``at_once``: the number of samples that are read at a time.
    """
    if local.cleaning.rule is not None:
        census = census_of(Cleaned(source, local, constraints), report, at_once)
    return local.over(census or census_of(source, report, at_once))
