"""The accessor ``.meshflow`` on objects of pyvista and xarray.

pyvista finds it through an entry point on the first ``mesh.meshflow``; for xarray, ``import meshflow.accessors`` registers it.
"""

from importlib.util import find_spec
from typing import Any

from meshflow.errors import InputError
from meshflow.geometry.validation import must_be_truth
from meshflow.io.adapters.xarray import further_dimensions
from meshflow.large.stacks import Slices
from meshflow.smoothing import smooth

__all__ = ["DatasetSmoothing", "Smoothing"]


class Smoothing:
    """The functions of meshflow for the object that it is an attribute of; the object itself is not changed.

    :param data: a PolyData, flat ImageData or StructuredGrid, or a DataArray.
    """

    def __init__(self, data: Any) -> None:
        self._data = data

    def smooth(self, **options: Any) -> Any:
        """Smooth the object with :func:`meshflow.smooth`; returns a new object of its kind, or with ``result=True`` a Result."""
        return smooth(self._data, **options)


class DatasetSmoothing:
    """The functions of meshflow for the variables of a Dataset. They do not change the Dataset.

    :param data: an ``xarray.Dataset``.
    """

    def __init__(self, data: Any) -> None:
        self._data = data

    def smooth(self, *names: str, **options: Any) -> Any:
        """Smooth variables one by one with :func:`meshflow.smooth`; returns a new Dataset in which all others are unchanged.

        :param names: of the variables; none: all with two dimensions or more that hold real numbers.
        :param options: of :func:`meshflow.smooth`. ``slices`` is for the variables that have some. With ``result=True`` the
            results are returned, a mapping by the names of the variables whose ``data`` is the new Dataset.
        :raises InputError: for a name that is not there, and as :func:`meshflow.smooth`, the variable named.
        """
        gone = [name for name in names if name not in self._data.data_vars]
        if gone:
            raise InputError(
                f"{', '.join(gone)}: no such variable; there are {', '.join(map(str, self._data.data_vars))}"
            )
        every = [str(name) for name, one in self._data.data_vars.items() if one.ndim > 1 and one.dtype.kind in "fiu"]
        asked, found = options.pop("result", False), {}
        must_be_truth(asked, "result")
        chosen = names or every
        series = [one for one in chosen if self._data[one].ndim > 2 and further_dimensions(self._data[one])]
        for name in chosen:
            # Beside series, what does not change with time has no slices.
            own = {**options, "slices": None} if series and name not in series else options
            try:
                found[name] = smooth(self._data[name], **own, result=asked)
            except InputError as cause:
                raise InputError(f"variable {name}: {cause}") from cause
        made = self._data.assign({name: one.data for name, one in found.items()} if asked else found)
        return Slices(made, found, "variable") if asked else made


if find_spec("pyvista"):
    import pyvista

    pyvista.register_dataset_accessor("meshflow", pyvista.DataSet)(Smoothing)
if find_spec("xarray"):
    from xarray import register_dataarray_accessor, register_dataset_accessor

    register_dataarray_accessor("meshflow")(Smoothing)
    register_dataset_accessor("meshflow")(DatasetSmoothing)
