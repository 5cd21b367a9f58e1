"""``.meshflow`` on the objects of pyvista and xarray.

pyvista finds it by its entry point, at the first ``mesh.meshflow``; of xarray ``import meshflow.accessors`` brings it.
"""

from importlib.util import find_spec
from typing import Any

from meshflow.results.result import Result
from meshflow.smoothing import denoise, smooth

__all__ = ["Smoothing"]


class Smoothing:
    """What meshflow does, on the object it hangs on; that object stays as it is.

    :param thing: a PolyData, flat ImageData or StructuredGrid, or a DataArray.
    """

    def __init__(self, thing: Any) -> None:
        self._thing = thing

    def smooth(self, **options: Any) -> Any:
        """:func:`meshflow.smooth` of the object: a new one of its kind."""
        return smooth(self._thing, **options)

    def denoise(self, **options: Any) -> Result:
        """:func:`meshflow.denoise` of the object."""
        return denoise(self._thing, **options)


if find_spec("pyvista"):
    from pyvista import DataSet, register_dataset_accessor

    register_dataset_accessor("meshflow", DataSet)(Smoothing)
if find_spec("xarray"):
    from xarray import register_dataarray_accessor

    register_dataarray_accessor("meshflow")(Smoothing)
