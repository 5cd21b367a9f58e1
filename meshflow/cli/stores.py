"""``meshflow smooth`` of variables of a Zarr store: lazily, chunk by chunk."""

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from meshflow.cli.asking import asked, narrowed
from meshflow.cli.flags import Given
from meshflow.cli.inputs import plain_sample, read_options
from meshflow.cli.many import Told
from meshflow.errors import InputError, need
from meshflow.estimate.request import Request
from meshflow.flow.methods import words_for
from meshflow.flow.progress import Progress, reporting
from meshflow.io.adapters.xarray import further_dimensions
from meshflow.io.atomic_write import must_be_free
from meshflow.io.stores import Delayed, Place, Stored, in_store, opened_store, readable, written_variables
from meshflow.kernels.library import default_threads
from meshflow.large.outcome import Outcome
from meshflow.large.stacks import Slices
from meshflow.smoothing import smooth_lazily

__all__ = ["is_of_stores", "smooth_store"]

# What a variable may need beside its attributes.
READ = ("kind", "nodata", "spacing", "unit", "slices")
# Options of other files: they are read as a whole, or by GDAL.
ELSEWHERE = (
    "picture", "report", "removed", "uncertainty", "driver", "creation", "dtype", "window", "bounds", "crs", "most_memory",
    "camera", "depth_scale", "measure", "band", "channels", "viewpoint", "moves", "time_unit",
)  # fmt: skip


def is_of_stores(given: Given) -> bool:
    """Whether IN or OUT is a variable of a store."""
    return any(in_store(given[name]) is not None for name in ("source", "target"))


def smooth_store(given: Given) -> Told:
    """Smooth a variable of a store, or all of them one by one, into another store.

    Beside all variables, the other store holds what else the group holds.

    :raises InputError: where only one of both is a store, and for options of other files.
    """
    source, target = (_place(given, name) for name in ("source", "target"))
    for name in ELSEWHERE:
        if given[name] not in (None, [], ()):
            raise InputError(f"{name}: not for a Zarr store; leave it out")
    if source.store.resolve() == target.store.resolve():
        raise InputError(f"{target}: it is the input; name another store")
    must_be_free(target.store, given["overwrite"])
    stored = opened_store(source)
    if len(stored.names) > 1 and target.variable:
        raise InputError(f"{target}: it names a variable, and {source.store} has {len(stored.names)}; name the store")
    word, suiting = given["method"], words_for(points=False)
    request = asked(given, plain_sample, suiting)
    with readable(source.store):
        made, found = _smoothed(stored, source, request, given)
    threads = request.compute.threads or default_threads()
    computed = _Computed(source.store, threads, None if given["quiet"] else True)
    beside = stored.group if len(made) > 1 else None
    written_variables(made, target, beside=beside, overwrite=given["overwrite"], compute=computed)
    found = found.computed()
    return Told(found, (*narrowed(request, word, suiting), *found.warnings))


def _smoothed(stored: Stored, source: Place, request: Request, given: Given) -> tuple[dict[str, Any], Slices | Outcome]:
    """Variables, smoothed one by one and not computed yet, and what is known of them.

    :raises InputError: for further dimensions without a word on them, and as for a single one, the variable named.
    """
    several, further = len(stored.names) > 1, {}
    for name in stored.names:
        further[name] = further_dimensions(stored.variable(name))
        if further[name] and given["slices"] is None:
            which = f"{source}: {name}" if several else source
            raise InputError(
                f"{which} has further dimensions: {', '.join(map(str, further[name]))}; choose --slices each or --slices alike"
            )
    made, found = dict[str, Any](), dict[str, Slices | Outcome]()
    for name in stored.names:
        # Beside series, what does not change with time has no slices.
        options = {key: given[key] for key in READ if not (key == "slices" and several and not further[name])}
        try:
            made[name], found[name] = smooth_lazily(stored.variable(name), request, read_options(options), measure=True)
        except InputError as cause:
            raise InputError(f"variable {name}: {cause}") from cause if several else cause
    return made, Slices(made, found, "variable") if several else found[stored.names[0]]


def _place(given: Given, name: str) -> Place:
    place = in_store(given[name])
    if place is None:
        raise InputError(f"{given[name]}: a Zarr store expected beside a Zarr store, as in IN.zarr/VARIABLE OUT.zarr")
    return place


@dataclass(frozen=True)
class _Computed:
    """Computes an object of dask with threads, and says how far it is.

    :ivar store: of which chunks are read.
    """

    store: Path
    threads: int
    progress: Progress

    def __call__(self, delayed: Delayed) -> object:
        """Compute it."""
        callbacks = need("dask.callbacks", "dask")
        done: list[object] = []
        with ExitStack() as stack:
            report = stack.enter_context(reporting(self.progress, "smoothing"))

            def told(key: object, result: object, graph: Any, state: Any, worker: object) -> None:
                """Count a task that is done."""
                done.append(key)
                report(
                    len(done) / max(len(done) + sum(len(state[name]) for name in ("waiting", "ready", "running")), 1)
                )

            stack.enter_context(callbacks.Callback(posttask=told))
            stack.enter_context(readable(self.store))
            return delayed.compute(scheduler="threads", num_workers=self.threads)
