"""What a run by windows did and why: a result without the data, which is in the file."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any
from uuid import uuid4

import numpy as np

from meshflow.estimate.noise import Noise
from meshflow.estimate.parameters import Parameter, value_unit
from meshflow.estimate.reported import parameters_of
from meshflow.estimate.risk import Candidate
from meshflow.flow.stops import AreaLoss, Residual
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array
from meshflow.large.legs import Leg
from meshflow.large.windows import Windowed
from meshflow.results.result import release
from meshflow.results.wording import as_numbers, as_text, candidates_in_numbers, chosen_in, described

__all__ = ["Measured", "Outcome", "Removed"]


@dataclass
class Removed:
    """What was removed, summed over windows.

    :ivar squares: the sum of its squares over all present values; ``count``: their number.
    :ivar largest: of a sample, in absolute value.
    """

    squares: float = 0.0
    count: int = 0
    largest: float = 0.0

    def add(self, before: Array, after: Array, missing: Array) -> None:
        """Count a window.

        :param before: values (r, c) or (r, c, k); ``after``: likewise; ``missing``: (r, c).
        """
        gone = (before.astype(np.float64) - after)[~missing]
        self.squares += float(np.square(gone).sum())
        self.count += gone.size
        self.largest = max(self.largest, float(np.abs(gone).max(initial=0.0)))

    @classmethod
    def joined(cls, parts: "Iterable[Removed]") -> "Removed":
        """What was removed from several files together."""
        found = cls()
        for part in parts:
            found.squares += part.squares
            found.count += part.count
            found.largest = max(found.largest, part.largest)
        return found

    @property
    def rms(self) -> float:
        """Root mean square."""
        return float(np.sqrt(self.squares / max(self.count, 1)))


@dataclass(eq=False)
class Measured:
    """What was removed from each chunk, noted in this process while the chunks are computed.

    :ivar parts: by the numbers of the chunk, so that one that is computed again counts once.
    :ivar token: tells it from others where dask compares what chunks are told.
    """

    parts: dict[tuple[int, ...], Removed] = field(default_factory=dict)
    token: str = field(default_factory=lambda: uuid4().hex)

    def add(self, numbers: tuple[int, ...], before: Array, after: Array, missing: Array) -> None:
        """Note a chunk; parameters of :meth:`Removed.add`."""
        one = Removed()
        one.add(before, after, missing)
        self.parts[numbers] = one


@named_fields
@dataclass(frozen=True, eq=False)
class Outcome:
    """A run in windows of a file, or in chunks that are computed later. ``print`` shows all parameters.

    :ivar run: the plan.
    :ivar windows: their number.
    :ivar removed: from the whole; None: that is known once the data is computed.
    :ivar notes: sentences on the files.
    :ivar data: the smoothed data, of the kind that was given, not computed yet; None: it is in a file.
    :ivar word: what the windows are called.
    :ivar legs: by which they were run; empty: by one.
    :ivar measured: where chunks note what is removed from them; empty: nowhere.
    """

    run: Windowed
    windows: int
    removed: Removed | None = None
    notes: tuple[str, ...] = ()
    data: Any = field(default=None, repr=False)
    word: str = "window"
    legs: tuple[Leg, ...] = field(default=(), repr=False)
    measured: tuple[Measured, ...] = field(default=(), repr=False)

    def computed(self) -> "Outcome":
        """It after the computation, with what was removed."""
        if not self.measured:
            return self
        return replace(self, removed=Removed.joined(part for one in self.measured for part in one.parts.values()))

    @property
    def parameters(self) -> dict[str, Parameter]:
        """By name, each with its value, unit, origin and reason."""
        return parameters_of(self.run.found)

    @property
    def noise(self) -> Noise:
        """The noise that was found or given."""
        return self.run.found.noise

    @property
    def candidates(self) -> tuple[Candidate, ...]:
        """Those of the search, the chosen one first; empty where nothing was searched for."""
        return self.run.found.candidates

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences."""
        return (*self.run.found.warnings, *self.run.warnings)

    @property
    def stopped_because(self) -> str:
        """A sentence: the time, and by how many windows."""
        if self.run.found.idle is not None:
            return self.run.found.idle
        many = f"{self.windows} {self.word}{'s' * (self.windows != 1)}"
        if self.word == "window":
            many += f" with a halo of {self.halo} samples"
        if len(self.legs) > 1:
            many += f", in {len(self.legs)} legs with an exchange of the state between them"
        steps = self.run.found.request.steps
        ended = f"reached time {self.run.found.time:.6g}" if steps is None else f"took all {steps} steps asked for"
        met = self.run.local.met
        if self.run.longer is not None:
            asked = [one for one in self.run.found.request.stops if isinstance(one, (Residual, AreaLoss))]
            said = " or ".join(stop.said(stop.share) for stop in asked)
            ended = f"comes to {said} at a time that is known once it is computed,"
        elif met is not None:
            ended = f"came to {met.said} at time {met.time:.6g}"
        if self.run.local.plan.groups is not None:
            ended += ", then groups of similar patches,"
        return f"{ended} by {many}"

    @property
    def halo(self) -> int:
        """How many samples around a window decide what it becomes, in the widest of its legs."""
        return max((leg.halo for leg in self.legs), default=self.run.halo)

    @property
    def summary(self) -> str:
        """One line: why the run ended, what was chosen, what was removed."""
        if self.run.found.idle is not None:
            return self.stopped_because
        unit, noise = self._unit, self.noise.sigma
        removed = f"noise {noise:.4g}{unit}; how much is removed is known only when the data is computed"
        if self.removed is not None:
            removed = f"removed rms {self.removed.rms:.4g}{unit} of noise {noise:.4g}{unit}"
        return f"{self.stopped_because}; {chosen_in(self.parameters)}{removed}"

    @property
    def tags(self) -> dict[str, str]:
        """The parameters as text, for the tags of files."""
        return {"version": release(), **as_text(self.parameters), "stopped_because": self.stopped_because}

    def to_dict(self) -> dict[str, Any]:
        """Everything in types of JSON."""
        return {
            "version": release(),
            "stopped_because": self.stopped_because,
            "time": self.run.found.time,
            "windows": self.windows,
            "halo": self.halo,
            "legs": max(len(self.legs), 1),
            "parameters": as_numbers(self.parameters),
            "noise": self.noise.to_dict(),
            "removed": None if self.removed is None else {"rms": self.removed.rms, "largest": self.removed.largest},
            "candidates": candidates_in_numbers(self.candidates),
            "warnings": list(self.warnings),
        }

    def __str__(self) -> str:
        if self.removed is None:
            return described(self, "")
        return described(
            self, f"rms {self.removed.rms:.6g}{self._unit}, largest {self.removed.largest:.6g}{self._unit}"
        )

    @property
    def _unit(self) -> str:
        unit = value_unit(self.run.found.data)
        return f" {unit}" if unit else ""
