"""The accessor ``.meshflow`` on objects of pyvista and xarray.

pyvista finds it through an entry point on the first ``mesh.meshflow``; for xarray, ``import meshflow.accessors`` registers it.
"""

from importlib.util import find_spec
from typing import Any

from meshflow.errors import InputError
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
        :raises InputError: for a name that is not there, and as :func:`meshflow.smooth`, the variable named.
        """
        gone = [name for name in names if name not in self._data.data_vars]
        if gone:
            raise InputError(
                f"{', '.join(gone)}: no such variable; there are {', '.join(map(str, self._data.data_vars))}"
            )
        every = (str(name) for name, one in self._data.data_vars.items() if one.ndim > 1 and one.dtype.kind in "fiu")
        made = {}
        for name in names or every:
            try:
                made[name] = smooth(self._data[name], **options)
            except InputError as cause:
                raise InputError(f"variable {name}: {cause}") from cause
        return self._data.assign(made)


if find_spec("pyvista"):
    import pyvista

    pyvista.register_dataset_accessor("meshflow", pyvista.DataSet)(Smoothing)
if find_spec("xarray"):
    from xarray import register_dataarray_accessor, register_dataset_accessor

    register_dataarray_accessor("meshflow")(Smoothing)
    register_dataset_accessor("meshflow")(DatasetSmoothing)
