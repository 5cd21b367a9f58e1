"""Variables of Zarr stores, ``DATA.zarr`` or ``DATA.zarr/VARIABLE``: read lazily, and written chunk by chunk."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from meshflow.errors import FormatError, need
from meshflow.io.atomic_write import folder_beside, must_be_free

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

__all__ = ["Delayed", "Place", "in_store", "opened_variable", "written_variable"]

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


def opened_variable(place: Place) -> "DataArray":
    """A variable of a store, of which no sample is read, with the variable of its CRS among its coordinates.

    :raises FormatError: where there is no such store or variable, and where several could be meant.
    :raises MissingPackage: without zarr.
    """
    group, _, name = place.variable.rpartition("/")
    data = _opened(place.store, group)
    names = [str(one) for one in data.data_vars if data[one].ndim >= 2]
    if not name and len(names) == 1:
        name = names[0]
    if name not in names:
        what = f"no variable {name!r}" if name else "several variables" if names else "no variable of two dimensions"
        listed = f"; name one: {', '.join(str(place.store / group / one) for one in names)}" if names else ""
        raise FormatError(f"{place.store}: {what} in it{listed}")
    found = data[name]
    mapping = found.attrs.get(MAPPING, found.encoding.get(MAPPING))
    return found.assign_coords({mapping: data[mapping]}) if mapping in data.variables else found


def _opened(store: Path, group: str) -> "Dataset":
    """A group of a store.

    :raises FormatError: for what is none.
    """
    need("zarr", "zarr")
    xarray = need("xarray", "xarray")
    need("dask", "dask")
    if not store.is_dir():
        raise FormatError(f"{store} is no folder; a Zarr store expected")
    try:
        return xarray.open_zarr(store, group=group or None, chunks={})
    except (OSError, ValueError, KeyError) as cause:
        where = f"{store / group}: " if group else f"{store}: "
        raise FormatError(f"{where}no Zarr store of xarray ({' '.join(str(cause).split())})") from cause


def written_variable(
    data: "DataArray", place: Place, *, overwrite: bool, compute: Callable[[Delayed], object] | None = None
) -> None:
    """Write a variable as a store of its own, chunk by chunk; the store is complete, or as it was before.

    :param compute: computes a delayed object of dask; None: as the caller's scheduler does.
    :raises FormatError: where a store is there already, and where it cannot be written.
    """
    need("zarr", "zarr")
    must_be_free(place.store, overwrite)
    group, _, name = place.variable.rpartition("/")
    encoding = {key: value for key, value in data.encoding.items() if key in KEPT}
    if "chunks" in encoding:  # a chunk of the store is written by one task
        data = data.chunk(dict(zip(data.dims, encoding["chunks"], strict=True)))
    whole = data.rename(name or data.name or "values").to_dataset()
    with folder_beside(place.store, SUFFIX) as temporary:
        delayed = whole.to_zarr(
            temporary, group=group or None, mode="w", compute=False, encoding={name or data.name or "values": encoding}
        )
        (compute or _computed)(delayed)


def _computed(delayed: Delayed) -> object:
    return delayed.compute()
