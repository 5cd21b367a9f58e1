"""meshflow smooths anything that lives on a triangulated surface, with one cotangent operator.

The public names are found on first use; importing the package costs numpy and nothing else.
"""

from typing import TYPE_CHECKING

from meshflow.lazy import lazily

if TYPE_CHECKING:
    from meshflow.errors import FormatError, InputError, MissingPackage, NotConverged
    from meshflow.estimate.settings import Settings
    from meshflow.flow.controls import AreaChange, Embedded, Fixed, Until
    from meshflow.flow.engines.grid import GridFlow
    from meshflow.flow.engines.mesh import MeshFlow
    from meshflow.flow.march import State, march
    from meshflow.flow.methods.beltrami import Member
    from meshflow.flow.steppers import Explicit, SemiImplicit, SuperTime
    from meshflow.fusing import fuse
    from meshflow.io.export import to_mesh, to_normals, to_open3d, to_points, to_pyvista
    from meshflow.io.files import Document, read, write
    from meshflow.io.formats.cameras import read_camera, write_camera
    from meshflow.results.multipart import Results
    from meshflow.results.result import Result
    from meshflow.smoothing import denoise, smooth
    from meshflow.surfaces.camera import Orthographic, Pinhole
    from meshflow.surfaces.free import Axes, Rays
    from meshflow.surfaces.lift import HeightField, Image, Lift, Mesh, RangeImage
    from meshflow.surfaces.scanner import Scanner, Spherical
    from meshflow.surfaces.surface import Surface
    from meshflow.viewer.filming import film

_HOMES = {
    "errors": ("FormatError", "InputError", "MissingPackage", "NotConverged"),
    "viewer.filming": ("film",),
    "flow.controls": ("AreaChange", "Embedded", "Fixed", "Until"),
    "flow.march": ("State", "march"),
    "flow.engines.mesh": ("MeshFlow",),
    "flow.steppers": ("Explicit", "SemiImplicit", "SuperTime"),
    "fusing": ("fuse",),
    "surfaces.camera": ("Orthographic", "Pinhole"),
    "surfaces.lift": ("HeightField", "Image", "Lift", "Mesh", "RangeImage"),
    "flow.methods.beltrami": ("Member",),
    "surfaces.scanner": ("Scanner", "Spherical"),
    "surfaces.free": ("Axes", "Rays"),
    "surfaces.surface": ("Surface",),
    "flow.engines.grid": ("GridFlow",),
    "io.formats.cameras": ("read_camera", "write_camera"),
    "io.export": ("to_mesh", "to_normals", "to_open3d", "to_points", "to_pyvista"),
    "io.files": ("Document", "read", "write"),
    "results.multipart": ("Results",),
    "results.result": ("Result",),
    "estimate.settings": ("Settings",),
    "smoothing": ("denoise", "smooth"),
}
__all__ = sorted(name for names in _HOMES.values() for name in names)  # pyright: ignore[reportUnsupportedDunderAll]

__getattr__, __dir__ = lazily(__name__, _HOMES, rooms=("classics", "evaluate", "synthetic", "view"))
