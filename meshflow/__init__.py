"""meshflow smooths anything that lives on a triangulated surface, with one cotangent operator.

The public names are found on first use; importing the package costs numpy and nothing else.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from meshflow.errors import FormatError, InputError, MissingPackage, NotConverged
    from meshflow.filming import film
    from meshflow.flow.control import AreaChange, Embedded, Fixed, Until
    from meshflow.flow.march import State, march
    from meshflow.flow.rate import MeshFlow
    from meshflow.flow.step import Explicit, SemiImplicit, SuperTime
    from meshflow.fusing import fuse
    from meshflow.geometry.camera import Orthographic, Pinhole
    from meshflow.geometry.lift import HeightField, Image, Lift, Mesh, RangeImage
    from meshflow.geometry.member import Member
    from meshflow.geometry.scanner import Scanner, Spherical
    from meshflow.geometry.surface import Axes, Rays, Surface
    from meshflow.grid.rate import GridFlow
    from meshflow.io.cameras import read_camera, write_camera
    from meshflow.io.clouds import to_mesh, to_normals, to_open3d, to_points, to_pyvista
    from meshflow.io.files import Document, read, write
    from meshflow.parts import Results
    from meshflow.result import Result
    from meshflow.settings import Settings
    from meshflow.smoothing import denoise, smooth

_HOMES = {
    "errors": ("FormatError", "InputError", "MissingPackage", "NotConverged"),
    "filming": ("film",),
    "flow.control": ("AreaChange", "Embedded", "Fixed", "Until"),
    "flow.march": ("State", "march"),
    "flow.rate": ("MeshFlow",),
    "flow.step": ("Explicit", "SemiImplicit", "SuperTime"),
    "fusing": ("fuse",),
    "geometry.camera": ("Orthographic", "Pinhole"),
    "geometry.lift": ("HeightField", "Image", "Lift", "Mesh", "RangeImage"),
    "geometry.member": ("Member",),
    "geometry.scanner": ("Scanner", "Spherical"),
    "geometry.surface": ("Axes", "Rays", "Surface"),
    "grid.rate": ("GridFlow",),
    "io.cameras": ("read_camera", "write_camera"),
    "io.clouds": ("to_mesh", "to_normals", "to_open3d", "to_points", "to_pyvista"),
    "io.files": ("Document", "read", "write"),
    "parts": ("Results",),
    "result": ("Result",),
    "settings": ("Settings",),
    "smoothing": ("denoise", "smooth"),
}
_FOUND_IN = {name: home for home, names in _HOMES.items() for name in names}

__all__ = sorted(_FOUND_IN)  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> Any:
    if name == "view":
        return import_module("meshflow.view")
    if name not in _FOUND_IN:
        raise AttributeError(f"module 'meshflow' has no attribute {name!r}; it has {', '.join(__all__)}")
    value = getattr(import_module(f"meshflow.{_FOUND_IN[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
