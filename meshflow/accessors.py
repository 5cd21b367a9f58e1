"""``.meshflow`` on the objects of pyvista and xarray.

pyvista finds it by its entry point, at the first ``mesh.meshflow``; of xarray ``import meshflow.accessors`` brings it.
"""

from importlib.util import find_spec
from typing import Any

from meshflow.smoothing import smooth

__all__ = ["Smoothing"]


class Smoothing:
    """What meshflow does, on the object it hangs on; that object stays as it is.

    :param data: a PolyData, flat ImageData or StructuredGrid, or a DataArray.
    """

    def __init__(self, data: Any) -> None:
        self._data = data

    def smooth(self, **options: Any) -> Any:
        """:func:`meshflow.smooth` of the object: a new one of its kind, or with ``result=True`` a :class:`meshflow.Result`."""
        return smooth(self._data, **options)


if find_spec("pyvista"):
    from pyvista import DataSet, register_dataset_accessor

    register_dataset_accessor("meshflow", DataSet)(Smoothing)
if find_spec("xarray"):
    from xarray import register_dataarray_accessor

    register_dataarray_accessor("meshflow")(Smoothing)
