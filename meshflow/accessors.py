"""The accessor ``.meshflow`` on objects of pyvista and xarray.

pyvista finds it through an entry point on the first ``mesh.meshflow``; for xarray, ``import meshflow.accessors`` registers it.
"""

from importlib.util import find_spec
from typing import Any

from meshflow.smoothing import smooth

__all__ = ["Smoothing"]


class Smoothing:
    """The functions of meshflow for the object that it is an attribute of; the object itself is not changed.

    :param data: a PolyData, flat ImageData or StructuredGrid, or a DataArray.
    """

    def __init__(self, data: Any) -> None:
        self._data = data

    def smooth(self, **options: Any) -> Any:
        """Smooth the object with :func:`meshflow.smooth`; returns a new object of its kind, or with ``result=True`` a Result."""
        return smooth(self._data, **options)


if find_spec("pyvista"):
    from pyvista import DataSet, register_dataset_accessor

    register_dataset_accessor("meshflow", DataSet)(Smoothing)
if find_spec("xarray"):
    from xarray import register_dataarray_accessor

    register_dataarray_accessor("meshflow")(Smoothing)
