"""What a run did, and why: everything that was chosen, with its unit and where it came from."""

import json
from dataclasses import dataclass
from functools import cached_property
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np
from scipy.special import i0e

from meshflow.estimate.noise import Noise
from meshflow.estimate.parameters import Parameter, value_unit
from meshflow.estimate.risk import Trial
from meshflow.flow.march import State
from meshflow.geometry.validation import Array
from meshflow.surfaces.lift import Mesh, Noun, RangeImage, data_of

__all__ = ["Moment", "Result", "release"]


@dataclass(frozen=True)
class Moment:
    """A state of a run, in numbers.

    :ivar time: squared length; ``dt`` of the step that led here.
    :ivar area: of the surface in the space in which it is measured (values times the contrast), squared length.
    :ivar change: root mean square change since the start, unit of the values.
    :ivar largest: largest change of a sample since the start, likewise.
    """

    time: float
    dt: float
    area: float
    change: float
    largest: float


@dataclass(frozen=True, eq=False)
class Result:
    """A smoothed thing and how it came to be; ``print`` it to read it.

    :ivar thing: what came back, of the kind that was given.
    :ivar noun: the same as a noun of meshflow; ``before``: what it was made from.
    :ivar start: the state before the first step, and ``end``: the last.
    :ivar parameters: by name, each with its unit and origin.
    :ivar noise: what was found in the data; None where it was not looked for.
    :ivar trials: of the search, the chosen one first; empty where nothing was searched for.
    :ivar moments: the run, from start to end.
    :ivar reason: why it ended, a sentence.
    :ivar warnings: sentences.
    :ivar version: of meshflow.
    """

    thing: Any
    noun: Noun
    before: Noun
    start: State
    end: State
    parameters: dict[str, Parameter]
    noise: Noise | None
    trials: tuple[Trial, ...]
    moments: tuple[Moment, ...]
    reason: str
    warnings: tuple[str, ...]
    version: str

    @property
    def parts(self) -> dict[str, "Result"]:
        """None: it is of one thing. Those of several are :class:`meshflow.Results`."""
        return {}

    @property
    def removed(self) -> Array:
        """The method noise: what was there less what is there now, in the shape of the data; zero where samples are missing."""
        return self._removed

    @property
    def counted(self) -> Array:
        """What was removed as the noise is counted: over the samples that are there; where the points of a mesh move, (n,), the
        way along the normals of ``before``, as in pictures and in ``compare``: what only slides leaves the surface as it is.
        """
        if isinstance(self.before, Mesh) and self._points:
            return np.einsum("ij,ij->i", self.removed, np.asarray(self.before.normals))
        if isinstance(self.before, Mesh):
            return self.removed
        return self.removed[~self.before.missing]

    @property
    def left(self) -> float:
        """The noise that is still in what came back, unit of the values, as far as it was white: the flow of a flat grid, the
        heat equation of this time, leaves exp(-4 t) I0(4 t) of it, t in squared sample distances.
        """
        if self.noise is None:
            return 0.0
        step = 1.0 if self.parameters["time"].unit.startswith("pixel") else self.before.step
        return self.noise.sigma * float(i0e(4.0 * self.end.time / step**2))

    @property
    def correlation(self) -> float | None:
        """How far what was removed is from white noise: the root mean square of its correlation with itself at the eight nearest
        shifts of the grid, all channels together; 0 is white, 1 is all structure. None for meshes, or where nothing was removed.
        """
        return self._correlation

    @cached_property
    def _removed(self) -> Array:
        one, two = data_of(self.before).astype(np.float64), data_of(self.noun).astype(np.float64)
        if isinstance(self.before, Mesh):
            return one - two
        missing = self.before.missing
        assert missing is not None
        if isinstance(self.noun, RangeImage) and self.noun.missing is not None:
            missing = missing | self.noun.missing  # what was dropped was not smoothed
        gone = missing if one.ndim == 2 else missing[..., None]
        return np.subtract(one, two, where=~gone, out=np.zeros_like(one))

    @cached_property
    def _correlation(self) -> float | None:
        if isinstance(self.before, Mesh) or not self.removed.any():
            return None
        planes = self.removed.reshape(*self.removed.shape[:2], -1)
        there = ~self.before.missing
        planes = np.where(there[..., None], planes - planes[there].mean(axis=0), 0.0)
        power, found = float(np.mean(planes[there] ** 2)), []
        for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
            h, w = there.shape
            a = np.s_[: h - down, max(0, -right) : w - max(0, right)]
            b = np.s_[down:, max(0, right) : w + min(0, right)]
            both = there[a] & there[b]
            if both.any():
                found.append(float(np.mean(planes[a][both] * planes[b][both])) / power)
        return float(np.sqrt(np.mean(np.square(found)))) if found and power > 0 else None

    @property
    def facts(self) -> dict[str, str]:
        """Parameters as they were used, words to words: for the tags of files."""
        words = {"version": self.version}
        for name, parameter in self.parameters.items():
            value = parameter.value
            words[name] = value if isinstance(value, str) else f"{value:.6g}"
        words |= {"time": f"{self.end.time:.6g}", "steps": str(self.end.step), "stepper": self.end.stepper}
        return {**words, "ended": self.reason}

    @property
    def summary(self) -> str:
        """A line: why it ended, what was chosen, what was removed."""
        if self.end.step == 0:
            return self.reason
        p = self.parameters
        rays = isinstance(self.before, RangeImage)
        names = ("method", "order", "gamma") if rays else ("method", "order", "gamma", "sharpness", "patch", "contrast")
        names = [name for name in names if name in p]
        chosen = ", ".join(f"{name} {_short(p[name].value)}" for name in names)
        sigma = "" if self.noise is None else f" of noise {self.noise.sigma:.4g}{self._unit}"
        chosen = f"{chosen}; " if chosen else ""
        return f"{self.reason}; {chosen}removed {self._way}rms {self._rms:.4g}{self._unit}{sigma}"

    def words(self) -> dict[str, Any]:
        """All of it but the data, as JSON has it."""
        parameters = {
            name: {"value": p.value, "unit": p.unit, "origin": p.origin, **({"why": p.why} if p.why else {})}
            for name, p in self.parameters.items()
        }
        noise = None
        if self.noise is not None:
            noise = {
                "sigma": self.noise.sigma,
                "channels": list(self.noise.channels),
                "quantum": self.noise.quantum,
                "on_quantum": self.noise.share,
                "how": self.noise.how,
            }
        return {
            "version": self.version,
            "ended": self.reason,
            "time": self.end.time,
            "steps": self.end.step,
            "stepper": self.end.stepper,
            "parameters": parameters,
            "noise": noise,
            "removed": {
                "rms": self._rms,
                "largest": float(np.abs(self.counted).max()),
                "correlation": self.correlation,
            },
            "moments": [vars(moment) for moment in self.moments],
            "search": [_told(trial, i == 0) for i, trial in enumerate(self.trials)],
            "warnings": list(self.warnings),
        }

    def json(self, **options: Any) -> str:
        """:meth:`words` as JSON text; ``options`` of :func:`json.dumps`."""
        return json.dumps(self.words(), **options)

    def __str__(self) -> str:
        lines = [f"{self.reason}"]
        lines += [f"  {name:<11} {parameter}" for name, parameter in self.parameters.items()]
        correlation = "" if self.correlation is None else f", correlation {self.correlation:.3f} (0: white noise)"
        sizes = f"{self._way}rms {self._rms:.6g}{self._unit}, largest {np.abs(self.counted).max():.6g}{self._unit}"
        lines.append(f"  removed     {sizes}{correlation}")
        if self.trials:
            lines.append(f"  searched    {len(self.trials)} members; expected errors (rms), least first:")
            for trial in sorted(self.trials, key=lambda trial: trial.least[1])[:5]:
                words = (
                    f"{k} {v if isinstance(v, str) else format(v, '.4g')}" for k, v in trial.candidate.words.items()
                )
                error = f"{trial.risk:.6g}" if trial.least[1] > 0 else "below what can be told"
                lines.append(f"              {error} at time {trial.least[0]:.4g}: {', '.join(words)}")
        return "\n".join(lines + [f"  warning     {warning}" for warning in self.warnings])

    @property
    def _unit(self) -> str:
        """Of what is smoothed, behind a number; nothing where nobody has named it."""
        unit = value_unit(self.before)
        return f" {unit}" if unit else ""

    @property
    def _rms(self) -> float:
        """Root mean square of what was removed, over the samples that are there."""
        return float(np.sqrt(np.mean(self.counted**2)))

    @property
    def _way(self) -> str:
        """Along what it is counted, where that is not the values themselves."""
        return "along the normals " if self.counted.ndim == 1 and self.removed.ndim == 2 and self._points else ""

    @property
    def _points(self) -> bool:
        """Whether the points of a mesh in R^3 have moved, and nothing else."""
        return isinstance(self.before, Mesh) and self.before.moves == "points" and self.before.normals is not None


def _short(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.4g}"


def _told(trial: Trial, whole: bool) -> dict[str, Any]:
    """A trial; the ``whole`` of its curve only of the one that was chosen, which are hundreds of numbers else."""
    return {
        **trial.candidate.words,
        "time": trial.least[0],
        "risk": trial.risk,
        **({"curve": {"times": list(trial.times), "risks": list(trial.risks)}} if whole else {}),
    }


def release() -> str:
    """The version of this package."""
    try:
        return version("meshflow")
    except PackageNotFoundError:  # run from a checkout that is not installed
        return "unknown"
