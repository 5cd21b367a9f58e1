"""Smooths DataArrays with a further dimension, such as time, slice by slice: each by its own choice, or all by one."""

from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np

from meshflow.errors import InputError
from meshflow.estimate.parameters import value_unit
from meshflow.estimate.planner import noise_in
from meshflow.estimate.request import Request
from meshflow.geometry.options import named_fields
from meshflow.io.adapters.xarray import from_object, further_dimensions
from meshflow.io.metadata import ReadOptions
from meshflow.large.chunks import is_chunked, run_of_given, sample_of_chunked, smooth_chunked, unsteady
from meshflow.large.cleaning import bound_over
from meshflow.large.outcome import Outcome, Removed
from meshflow.large.sample import ENOUGH, Places, Sample, part_of, sample_of
from meshflow.large.source import Form, Held, OnGrid
from meshflow.large.windows import Windowed, on_grid, windowed
from meshflow.results.given_steps import is_uniform
from meshflow.results.result import Result
from meshflow.results.run import engine_of
from meshflow.surfaces.data import array_of

if TYPE_CHECKING:
    from xarray import DataArray

__all__ = ["Slices", "is_stack", "smooth_stack"]

# The most slices from which the noise and the choice of all are found.
LOOKED_AT = 8
# The factor between the noise of slices above which one choice is unsuited; in 30 stacks of equal noise it was at most 1.1.
FACTOR = 1.6
# The least number of samples from which the noise of a slice is told.
TELLING = 400
# Smooths one slice.
One = Callable[[Any, Request], tuple[Any, Result | Outcome]]


@named_fields
@dataclass(frozen=True, eq=False)
class Slices(Mapping[str, "Result | Outcome | Slices"]):
    """The results of a stack of slices, or of the variables of a Dataset, by their names. ``print`` shows them all.

    :ivar data: the smoothed stack, or Dataset.
    :ivar slices: the result of each slice.
    :ivar word: what the slices are called.
    """

    data: Any
    slices: "Mapping[str, Result | Outcome | Slices]"
    word: str = "slice"

    def __getitem__(self, name: str) -> "Result | Outcome | Slices":
        return self.slices[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.slices)

    def __len__(self) -> int:
        return len(self.slices)

    def computed(self) -> "Slices":
        """They after the computation, with what was removed from each where that was measured."""
        return replace(
            self, slices={name: one if isinstance(one, Result) else one.computed() for name, one in self.slices.items()}
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """Those of all slices; each once, with the first slice that has it."""
        found: dict[str, str] = {}
        for name, one in self.slices.items():
            for word in one.warnings:
                found.setdefault(word, name)
        return tuple(f"{self.word} {name}: {word}" for word, name in found.items())

    @property
    def summary(self) -> str:
        """A line for each slice."""
        return "\n".join(f"{name}: {one.summary}" for name, one in self.slices.items())

    @property
    def stopped_because(self) -> str:
        """A sentence with the number of slices."""
        return f"{len(self)} {self.word}s, each smoothed separately"

    def to_dict(self) -> dict[str, Any]:
        """Everything but the data, in types of JSON."""
        return {f"{self.word}s": {name: one.to_dict() for name, one in self.slices.items()}}

    def __str__(self) -> str:
        return "\n".join(f"{name}: {one}" for name, one in self.slices.items())


def is_stack(data: object, options: ReadOptions) -> "TypeGuard[DataArray]":
    """Whether it is a DataArray that is to be smoothed slice by slice.

    :raises InputError: where slices are asked for and there are none.
    """
    if options.slices is None:
        return False
    if options.slices not in ("each", "alike"):
        raise InputError(f"slices: each or alike expected, got {options.slices!r}")
    if not (type(data).__module__.startswith("xarray.") and hasattr(data, "dims") and not hasattr(data, "data_vars")):
        raise InputError(f"slices: of an xarray.DataArray with a further dimension, got {type(data).__name__}")
    return True


def smooth_stack(
    data: "DataArray", request: Request, options: ReadOptions, one: One, *, measure: bool = False
) -> tuple["DataArray", Slices | Outcome]:
    """Smooth the slices of a stack; a lazy stack comes back lazy, as one graph.

    With ``slices="each"`` every slice has its own noise, method and time; with ``"alike"`` they are found once, on up to eight
    slices spread over the stack, and what windows cannot do is refused.

    :param one: smooths one slice.
    :param measure: of :func:`smooth_chunked`, for lazy slices that are smoothed alike.
    :returns: the same kind of array, and the results of the slices, or that of all.
    :raises InputError: as for one slice; for a mask that is not that of a slice.
    """
    dims = further_dimensions(data)
    if not dims:
        raise InputError(f"slices: a dimension with several entries beside rows and columns expected, got {data.dims}")
    if options.missing is not None and np.ndim(options.missing) > 2:
        raise InputError("missing: one mask (rows, columns) for all slices expected; mark others by NaN")
    how, options, named = options.slices, replace(options, slices=None), _named(data, dims)
    if is_chunked(data) and request.compute.threads is None:
        request = replace(request, compute=replace(request.compute, threads=1))
    if how == "each":
        made = {name: one(part, request) for name, part in named.items()}
        back = _joined(data, dims, [done for done, _ in made.values()])
        return back, Slices(back, {name: found for name, (_, found) in made.items()})
    with request.compute.running():
        some = list(named.values())
        run = run_of_given(some[0], request, options) if is_chunked(data) else None
        run = run or _run_of(some, request, options)
    if is_chunked(data):
        lazy = [smooth_chunked(part, request, options, run, measure=measure) for part in named.values()]
        back = _joined(data, dims, [done for done, _ in lazy])
        measured = tuple(one for _, found in lazy for one in found.measured)
        return back, Outcome(run, len(lazy), data=back, word="slice", measured=measured)
    removed, made_alike = Removed(), []
    with request.compute.running():
        for part in named.values():
            made_alike.append(_as_planned(part, run, request, options, removed))
    back = _joined(data, dims, made_alike)
    return back, Outcome(run, len(made_alike), removed, data=back, word="slice")


def _named(data: "DataArray", dims: tuple[Hashable, ...]) -> dict[str, "DataArray"]:
    """The slices by their names, the last dimension fastest."""
    found = {}
    for places in product(*(range(data.sizes[dim]) for dim in dims)):
        at = dict(zip(dims, places, strict=True))
        said = (f"{dim}={_shown(data, dim, i)}" for dim, i in at.items())
        found[", ".join(said)] = data.isel(at)
    return found


def _shown(data: "DataArray", dim: Hashable, i: int) -> str:
    """The coordinate of a slice; its number where there is none."""
    if dim not in data.coords:
        return str(i)
    value = data.coords[dim].to_numpy()[i]
    return np.datetime_as_string(value, unit="auto") if isinstance(value, np.datetime64) else str(value)


def _joined(data: "DataArray", dims: tuple[Hashable, ...], slices: list["DataArray"]) -> "DataArray":
    """Smoothed slices as a stack with the dimensions, coordinates and attributes of the one that came."""
    values = [part.data for part in slices]
    for dim in reversed(dims):
        size = data.sizes[dim]
        values = [_stacked(values[i : i + size]) for i in range(0, len(values), size)]
    made = data.transpose(*dims, *slices[0].dims).copy(data=values[0]).transpose(*data.dims)
    made.encoding = {**slices[0].encoding}
    return made


def _stacked(values: list[Any]) -> Any:
    """Arrays of numpy or of dask along a new first axis."""
    if type(values[0]) is np.ndarray:
        return np.stack(values)
    import dask.array as da

    return da.stack(values)


def _run_of(slices: list["DataArray"], request: Request, options: ReadOptions) -> Windowed:
    """The plan of all slices, found on some of them.

    :raises InputError: for what cannot be done by windows.
    """
    count = min(len(slices), LOOKED_AT)
    some = [slices[i] for i in np.unique(np.linspace(0, len(slices) - 1, count).astype(int))]
    samples = [_sample_of(part, options, ENOUGH // count) for part in some]
    form, whole = samples[0][0], len(some) == len(slices) and all(sample.is_whole for _, sample in samples)
    run = windowed(form, _side_by_side(form, [sample for _, sample in samples]), request)
    if not whole and not is_uniform(engine_of(run.found)):
        raise unsteady(request)
    said = () if whole else (f"noise and method were found on {len(some)} of {len(slices)} slices",)
    if request.noise is None:
        said += _unlike([sample for _, sample in samples], request, run)
    return replace(run, warnings=(*run.warnings, *said))


def _unlike(samples: list[Sample], request: Request, run: Windowed) -> tuple[str, ...]:
    """A warning where the noise of slices differs plainly."""
    shape, found = run.local.form.shape, list[float]()
    for sample in samples:
        mask = sample.of(request.constraints, shape).mask
        used = ~sample.data.missing if mask is None else ~sample.data.missing & np.asarray(mask, bool)
        if np.count_nonzero(used) >= TELLING:
            found.append(noise_in(sample.data, used).sigma)
    least, most = min(found, default=0.0), max(found, default=0.0)
    if most <= FACTOR * least or most == 0.0:
        return ()
    unit = value_unit(run.found.data)
    factor = f"by a factor of {most / least:.2g}, " if least > 0 else ""
    return (
        f"the noise of the slices differs, {factor}from {least:.3g} to {f'{most:.3g} {unit}'.strip()}, and all are smoothed by "
        "one choice; slices='each' smooths each slice by its own noise",
    )


def _sample_of(part: "DataArray", options: ReadOptions, enough: int) -> tuple[Form, Sample]:
    """The form of a slice, and its sample."""
    if is_chunked(part):
        return sample_of_chunked(part, options, enough)
    source = Held(on_grid(from_object(part, options).data))
    return source.form, sample_of(source, enough)


def _side_by_side(form: Form, samples: list[Sample]) -> Sample:
    """Samples of slices below each other, with a row of missing ones between them."""
    rows, values, missing = [], [], []
    for sample in samples:
        z, gone = array_of(sample.data), sample.data.missing
        rows += [sample.places.axes[0], np.array([-1])]
        values += [z, np.zeros((1, *z.shape[1:]), z.dtype)]
        missing += [gone, np.ones((1, *gone.shape[1:]), bool)]
    joined = np.concatenate(rows[:-1])
    data = form.data(np.concatenate(values[:-1]), np.concatenate(missing[:-1]), np.maximum(joined, 0))
    return Sample(data, Places((joined, *samples[0].places.axes[1:]), True))


def _as_planned(
    part: "DataArray", run: Windowed, request: Request, options: ReadOptions, removed: Removed
) -> "DataArray":
    """A slice in memory, smoothed as planned; what was removed is counted."""
    imported = from_object(part, options)
    data: OnGrid = on_grid(imported.data)
    whole = tuple(slice(0, size) for size in data.missing.shape)
    held = part_of(request.constraints, data.missing.shape, whole)
    before = array_of(data)
    bound = bound_over(run.local, Held(data), request.constraints)
    after = bound.moved((whole, whole), before, data.missing, held)
    removed.add(before, after, data.missing)
    return imported.to_object(run.local.form.data(after, data.missing))
