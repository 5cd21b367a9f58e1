"""Variables of Zarr stores, ``DATA.zarr`` or ``DATA.zarr/VARIABLE``: read lazily, and written chunk by chunk."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from traceback import walk_tb
from typing import TYPE_CHECKING, Any, Protocol

from meshflow.errors import FormatError, need, said_by
from meshflow.io.atomic_write import folder_beside, must_be_free

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

__all__ = [
    "Delayed", "Place", "Stored", "in_store", "opened_store", "opened_variable", "readable", "written_variables",
]  # fmt: skip

SUFFIX = ".zarr"
# The attribute that names the variable with the CRS (CF conventions).
MAPPING = "grid_mapping"
# How a written array is stored is that of the read one, but for what depends on its numbers.
KEPT = ("chunks", "compressor", "compressors", "filters", "shards")


class Delayed(Protocol):
    """What dask computes later."""

    def compute(self, *, scheduler: str | None = None, num_workers: int | None = None) -> object:
        """Compute it."""
        ...


@dataclass(frozen=True)
class Place:
    """Where a variable lies.

    :ivar store: the folder ``DATA.zarr``.
    :ivar variable: its name, with that of its group; empty: the only one.
    """

    store: Path
    variable: str = ""

    def __str__(self) -> str:
        return str(self.store / self.variable if self.variable else self.store)


def in_store(path: Path) -> Place | None:
    """The place in a store that a path names; None for a path of anything else."""
    for at in range(len(path.parts), 0, -1):
        if path.parts[at - 1].lower().endswith(SUFFIX):
            return Place(Path(*path.parts[:at]), "/".join(path.parts[at:]))
    return None


@dataclass(frozen=True, eq=False)
class Stored:
    """Variables of a group of a store, of which no sample is read.

    :ivar group: with all its variables.
    :ivar names: of those that are meant: the one that was named, or all with two dimensions or more that hold real numbers.
    """

    group: "Dataset"
    names: tuple[str, ...]

    def variable(self, name: str) -> "DataArray":
        """A variable with that of its CRS among its coordinates."""
        found = self.group[name]
        mapping = found.attrs.get(MAPPING, found.encoding.get(MAPPING))
        return found.assign_coords({mapping: self.group[mapping]}) if mapping in self.group.variables else found


def opened_store(place: Place) -> Stored:
    """The variables of a store that a place names.

    :raises FormatError: where there is no such store or variable.
    :raises MissingPackage: without zarr.
    """
    group, _, name = place.variable.rpartition("/")
    data = _opened(place.store, group)
    names = tuple(str(one) for one in data.data_vars if data[one].ndim >= 2 and data[one].dtype.kind in "fiu")
    if name not in names and (name or not names):
        listed = f"; name one: {', '.join(str(place.store / group / one) for one in names)}" if names else ""
        if name in data.variables:
            raise FormatError(f"{place}: {_unfit(data[name])}{listed}")
        what = f"no variable {name!r}" if name else "no variable of two dimensions"
        raise FormatError(f"{place.store}: {what} in it{listed}")
    return Stored(data, (name,) if name else names)


def _unfit(variable: "DataArray") -> str:
    """Why a variable cannot be smoothed."""
    if variable.ndim < 2:
        many = f"{variable.ndim} dimension{'s' * (variable.ndim != 1)}"
        return f"two dimensions or more expected, rows and columns; it has {many}"
    if variable.dtype.kind in "fiu":
        return "it is a coordinate of others, and no variable"
    return f"real numbers expected, got {variable.dtype}"


def opened_variable(place: Place) -> "DataArray":
    """The one variable that a place names, with that of its CRS among its coordinates.

    :raises FormatError: as :func:`opened_store`, and where several could be meant.
    """
    stored = opened_store(place)
    first, *others = stored.names
    if others:
        listed = ", ".join(str(place.store / name) for name in stored.names)
        raise FormatError(f"{place.store}: several variables in it; name one: {listed}")
    return stored.variable(first)


def _opened(store: Path, group: str) -> "Dataset":
    """A group of a store.

    :raises FormatError: for what is none.
    """
    need("zarr", "zarr")
    xarray = need("xarray", "xarray")
    need("dask", "dask")
    if not store.is_dir():
        raise FormatError(f"{store} is no folder; a Zarr store expected")
    with readable(store):
        try:
            return xarray.open_zarr(store, group=group or None, chunks={})
        except (OSError, ValueError, KeyError) as cause:
            where = f"{store / group}: " if group else f"{store}: "
            raise FormatError(f"{where}no Zarr store of xarray ({' '.join(str(cause).split())})") from cause


@contextmanager
def readable(store: Path) -> Iterator[None]:
    """Say of a store what fails while chunks of it are read; all other failures pass.

    :raises FormatError: it names the store.
    """
    try:
        yield
    except MemoryError:
        raise
    except Exception as cause:  # decoders have many exceptions, none of which is that of all
        frames = (frame for frame, _ in walk_tb(cause.__traceback__))
        names = {(frame.f_globals.get("__name__"), frame.f_code.co_name) for frame in frames}
        if ("xarray.backends.zarr", "__getitem__") not in names:
            raise
        raise FormatError(f"{store}: a chunk of it cannot be read ({said_by(cause)}); restore the file") from cause


def written_variables(
    made: Mapping[str, "DataArray"],
    place: Place,
    *,
    beside: "Dataset | None" = None,
    overwrite: bool,
    compute: Callable[[Delayed], object] | None = None,
) -> None:
    """Write variables as a store of their own, chunk by chunk; the store is complete, or as it was before.

    :param made: by their names; a single one takes the name of the place, if that has one.
    :param beside: what else the store holds.
    :param compute: computes a delayed object of dask; None: as the caller's scheduler does.
    :raises FormatError: where a store is there already, and where it cannot be written.
    """
    need("zarr", "zarr")
    xarray = need("xarray", "xarray")
    must_be_free(place.store, overwrite)
    group, _, name = place.variable.rpartition("/")
    whole, encodings = xarray.Dataset() if beside is None else beside, dict[str, dict[Any, Any]]()
    for own, data in made.items():
        named = (name or own) if len(made) == 1 else own
        encodings[named] = {key: value for key, value in data.encoding.items() if key in KEPT}
        if "chunks" in encodings[named]:  # a chunk of the store is written by one task
            data = data.chunk(dict(zip(data.dims, encodings[named]["chunks"], strict=True)))
        whole = whole.assign({named: data})
    with folder_beside(place.store, SUFFIX) as temporary:
        delayed = whole.to_zarr(temporary, group=group or None, mode="w", compute=False, encoding=encodings)
        (compute or _computed)(delayed)


def _computed(delayed: Delayed) -> object:
    return delayed.compute()
