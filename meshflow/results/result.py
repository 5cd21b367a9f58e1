"""The result of a run: the data, and every parameter with its unit, origin and reason."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import i0e

from meshflow.estimate.noise import Noise
from meshflow.estimate.parameters import Parameter, Parameters, value_unit
from meshflow.estimate.plan import Plan
from meshflow.estimate.risk import Candidate
from meshflow.flow.march import State
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array
from meshflow.results.wording import as_numbers, as_text, candidates_in_numbers, chosen_in, described
from meshflow.surfaces.data import Data, array_of
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.volume import Volume

__all__ = ["History", "Result", "release"]


# Those left out for range images, where they are always the same.
ALONG_RAYS = ("sharpness", "patch", "contrast")
# Shifts of the samples of a grid, and of a volume, half of them.
SHIFTS, SHIFTS_OF_VOLUMES = ((0, 1), (1, 0), (1, 1), (1, -1)), ((0, 0, 1), (0, 1, 0), (1, 0, 0))
# Values of a grid that are compared at a time.
AT_ONCE = 1 << 20


@dataclass(frozen=True, eq=False)
class History:
    """A run in numbers: arrays (m,) with one entry per state, from the start to the end.

    :ivar time: squared length; ``dt``: the length of the step that led to the state.
    :ivar area: of the surface in the space in which it is measured (values times the contrast), squared length.
    :ivar change: root mean square change since the start, unit of the values.
    :ivar largest: largest change of a sample since the start, likewise.
    """

    time: Array
    dt: Array
    area: Array
    change: Array
    largest: Array

    @classmethod
    def joined(cls, parts: Sequence["History"]) -> "History":
        """Concatenate histories; without any, an empty history."""
        return cls(*(np.concatenate([np.empty(0), *(getattr(part, f.name) for part in parts)]) for f in fields(cls)))

    def __len__(self) -> int:
        return len(self.time)

    def to_list(self) -> list[dict[str, float]]:
        """One dictionary per state, in types of JSON."""
        return [{f.name: float(getattr(self, f.name)[i]) for f in fields(self)} for i in range(len(self))]


@named_fields
@dataclass(frozen=True, eq=False)
class Result:
    """Smoothed data and how it was made. ``print`` shows all parameters.

    :ivar data: the smoothed data, of the kind that was given.
    :ivar after: the smoothed data as a data object of meshflow; ``before``: the data object before smoothing.
    :ivar start: the state before the first step; ``end``: the last state.
    :ivar parameters: by name, each with its value, unit, origin and reason. Numeric parameters behave as numbers.
    :ivar noise: the noise found in the data.
    :ivar candidates: those of the search, the chosen one first; empty where nothing was searched for.
    :ivar history: the run, from start to end.
    :ivar stopped_because: why the run ended, as a sentence.
    :ivar warnings: sentences.
    :ivar version: the version of meshflow.
    :ivar notes: what was done when the data was read; nothing that needs attention.
    :ivar plan: of the run; None where it ran on other numbers than these (inverse depths, another colour space).
    """

    data: Any
    after: Data
    before: Data
    start: State
    end: State
    parameters: dict[str, Parameter]
    noise: Noise
    candidates: tuple[Candidate, ...]
    history: History
    stopped_because: str
    warnings: tuple[str, ...]
    version: str
    notes: tuple[str, ...] = ()
    plan: Plan | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", Parameters(self.parameters))

    @property
    def parts(self) -> dict[str, "Result"]:
        """Empty, since the data has one part; the results of several parts are :class:`meshflow.Results`."""
        return {}

    @property
    def removed(self) -> Array:
        """The method noise, before minus after, in the shape of the data; zero where samples are missing."""
        return self._removed

    @property
    def counted(self) -> Array:
        """What was removed, measured as the noise is: over all samples that are not missing.

        Where the points of a mesh move, it is the displacement (n,) along the normals of ``before``, as in pictures and in
        ``compare``: sliding along the surface does not change it.
        """
        if isinstance(self.before, Mesh) and self._points:
            return np.einsum("ij,ij->i", self.removed, np.asarray(self.before.normals))
        if isinstance(self.before, Mesh):
            return self.removed
        return self.removed[~self.before.missing]

    @property
    def left(self) -> float:
        """The noise left in the smoothed data, in the unit of the values, if the noise was white.

        On a flat grid the flow is the heat equation of this time, which leaves exp(-4 t) I0(4 t) of it, t in squared sample
        distances.
        """
        if isinstance(self.before, Volume):
            steps = np.array(self.before.spacing)
            return self.noise.sigma * float(np.prod(np.sqrt(i0e(4.0 * self.end.time / steps**2))))
        if isinstance(self.before, TetMesh):
            return self.noise.sigma * float(i0e(4.0 * self.end.time / self.before.step**2)) ** 1.5
        step = 1.0 if self.parameters["time"].unit.startswith("pixel") else self.before.step
        return self.noise.sigma * float(i0e(4.0 * self.end.time / step**2))

    @property
    def correlation(self) -> float | None:
        """How much what was removed differs from white noise; None for meshes, and where nothing was removed.

        It is the root mean square of the autocorrelation at the eight nearest shifts of a grid, the six of a volume, all channels
        together: 0 for white noise, 1 for structure alone.
        """
        return self._correlation

    @cached_property
    def _removed(self) -> Array:
        return self._removed_from(slice(None))

    def _removed_from(self, rows: slice) -> Array:
        """What was removed from some rows of a grid, or some vertices of a mesh."""
        one, two = array_of(self.before)[rows].astype(np.float64), array_of(self.after)[rows]
        if isinstance(self.before, Mesh):
            return one - two
        missing = self.before.missing[rows]
        if isinstance(self.after, RangeImage) and self.after.missing is not None:
            missing = missing | self.after.missing[rows]  # dropped samples were not smoothed
        gone = missing if one.ndim == missing.ndim else missing[..., None]
        return np.subtract(one, two, where=~gone, out=np.zeros_like(one))

    @cached_property
    def _sizes(self) -> tuple[float, float]:
        """Root mean square and the largest of what was removed, in absolute value; of grids it is found by bands of rows."""
        if isinstance(self.before, Mesh):
            return float(np.sqrt(np.mean(self.counted**2))), float(np.abs(self.counted).max())
        squares, count, largest = 0.0, 0, 0.0
        for rows in self._bands:
            found = self._removed_from(rows)[~self.before.missing[rows]]
            squares, count = squares + float(np.square(found).sum()), count + found.size
            largest = max(largest, float(np.abs(found).max(initial=0.0)))
        return float(np.sqrt(squares / max(count, 1))), largest

    @property
    def _bands(self) -> list[slice]:
        """Rows of a grid that are looked at together: what is made of all of them takes several times its memory."""
        shape = array_of(self.before).shape
        high = max(1, AT_ONCE // int(np.prod(shape[1:])))
        return [slice(top, min(top + high, shape[0])) for top in range(0, shape[0], high)]

    @cached_property
    def _correlation(self) -> float | None:
        if isinstance(self.before, (Mesh, TetMesh)):
            return None
        there = ~self.before.missing
        sums = np.array([self._removed_from(rows)[there[rows]].sum(axis=0) for rows in self._bands])
        mean = sums.sum(axis=0) / max(int(there.sum()), 1)
        shifts = SHIFTS if there.ndim == 2 else SHIFTS_OF_VOLUMES
        # For no shift and for each one: the sum of the products of the samples that it joins, and their number.
        found = np.zeros((1 + len(shifts), 2))
        for rows in self._bands:
            wide = slice(rows.start, rows.stop + max(shift[0] for shift in shifts))
            own, high = there[wide], rows.stop - rows.start
            planes = np.where(own[..., None], (self._removed_from(wide) - mean).reshape(*own.shape, -1), 0.0)
            for sum_of, shift in zip(found, ((0,) * there.ndim, *shifts), strict=True):
                sum_of += _products(planes, own, shift, high)
        with np.errstate(invalid="ignore", divide="ignore"):
            power, *others = (found[:, 0] / found[:, 1])[found[:, 1] > 0]
        return float(np.sqrt(np.mean(np.square(others)))) / float(power) if others and power > 0 else None

    @property
    def tags(self) -> dict[str, str]:
        """The parameters as text, for the tags of files."""
        words = {"version": self.version, **as_text(self.parameters)}
        words |= {"time": f"{self.end.time:.6g}", "steps": str(self.end.step), "stepper": self.end.stepper}
        return {**words, "stopped_because": self.stopped_because}

    @property
    def summary(self) -> str:
        """One line: why the run ended, what was chosen, what was removed."""
        if self.end.step == 0:
            return self.stopped_because
        chosen = chosen_in(self.parameters, ALONG_RAYS if isinstance(self.before, RangeImage) else ())
        sigma = f" of noise {self.noise.sigma:.4g}{self._unit}"
        return f"{self.stopped_because}; {chosen}removed {self._along}rms {self._rms:.4g}{self._unit}{sigma}"

    def to_dict(self) -> dict[str, Any]:
        """Everything but the data, in types of JSON."""
        return {
            "version": self.version,
            "stopped_because": self.stopped_because,
            "time": self.end.time,
            "steps": self.end.step,
            "stepper": self.end.stepper,
            "parameters": as_numbers(self.parameters),
            "noise": self.noise.to_dict(),
            "removed": {
                "rms": self._rms,
                "largest": self._sizes[1],
                "correlation": self.correlation,
            },
            "history": self.history.to_list(),
            "candidates": candidates_in_numbers(self.candidates),
            "warnings": list(self.warnings),
            "notes": list(self.notes),
        }

    def to_json(self, **options: Any) -> str:
        """:meth:`to_dict` as JSON text; ``options`` of :func:`json.dumps`."""
        return json.dumps(self.to_dict(), **options)

    def report(self, path: str | Path, *, title: str = "", overwrite: bool = False) -> Path:
        """Write a report: before, after, removed, parameters and their reasons, risk.

        :param path: ``.html`` or ``.png``.
        :param title: by default the name of the file.
        :param overwrite: replace an existing file.
        :returns: the path.
        :raises FormatError: for another extension, or a file that exists.
        """
        from meshflow.view.report import report

        report(self, path, title=title or Path(path).stem, overwrite=overwrite)
        return Path(path)

    def _repr_html_(self) -> str:
        """Before, after, removed and how the run went, for notebooks."""
        from meshflow.view.report import excerpt

        return excerpt(self)

    def __str__(self) -> str:
        correlation = "" if self.correlation is None else f", correlation {self.correlation:.3f} (0: white noise)"
        sizes = f"{self._along}rms {self._rms:.6g}{self._unit}, largest {self._sizes[1]:.6g}{self._unit}"
        return described(self, sizes + correlation)

    @property
    def _unit(self) -> str:
        """The unit of the smoothed values with a space before it; empty where it is not known."""
        unit = value_unit(self.before)
        return f" {unit}" if unit else ""

    @property
    def _rms(self) -> float:
        """Root mean square of what was removed, over the samples that are not missing."""
        return self._sizes[0]

    @property
    def _along(self) -> str:
        """The direction in which the change is measured, where that is not the values themselves."""
        return "along the normals " if self._points and self.removed.ndim == 2 and self.counted.ndim == 1 else ""

    @property
    def _points(self) -> bool:
        """Whether only the points of a mesh in R^3 have moved."""
        return isinstance(self.before, Mesh) and self.before.moves == "points" and self.before.normals is not None


@lru_cache(maxsize=1)
def release() -> str:
    """The version of this package."""
    try:
        return version("meshflow")
    except PackageNotFoundError:  # a checkout that is not installed
        return "unknown"


def _products(planes: Array, there: Array, shift: tuple[int, ...], high: int) -> tuple[float, int]:
    """The sum of the products of samples and those at a shift from them, and the number of such pairs.

    :param planes: (r, c, k), of a volume (s, r, c, k), zero where samples are missing; ``there``: (r, c).
    :param high: in how many of its first rows one of both lies.
    """
    shape = (high, *there.shape[1:])
    a = tuple(
        slice(max(0, -by), min(of, size - max(0, by))) for by, of, size in zip(shift, shape, there.shape, strict=True)
    )
    b = tuple(slice(part.start + by, part.stop + by) for part, by in zip(a, shift, strict=True))
    channels = planes.shape[-1]
    return float(np.vdot(planes[a], planes[b])), channels * int(np.count_nonzero(there[a] & there[b]))
