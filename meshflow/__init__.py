"""meshflow smooths meshes, elevation models, range images and images with one cotangent operator.

Public names are imported on first use: ``import meshflow`` imports numpy and nothing else.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from meshflow.lazy import lazily

if TYPE_CHECKING:
    from meshflow.comparing import MethodRun, compare_methods
    from meshflow.errors import FormatError, InputError, MeshflowWarning, MissingPackage, NotConverged
    from meshflow.estimate.constraints import (
        DataWeights,
        Fixed,
        Mask,
        MaxChange,
        MinComponent,
        Mobility,
        PreserveArea,
        PreserveVolume,
    )
    from meshflow.estimate.noise import Noise
    from meshflow.flow.compute import Compute
    from meshflow.flow.controls import AreaChange, Embedded, FixedStep, Until
    from meshflow.flow.engines.grid import GridFlow
    from meshflow.flow.engines.mesh import MeshFlow
    from meshflow.flow.engines.tetrahedra import TetFlow
    from meshflow.flow.engines.volume import VolumeFlow
    from meshflow.flow.family import Variant
    from meshflow.flow.march import State, march
    from meshflow.flow.methods import (
        Beltrami,
        ConformalFlow,
        CurvatureFlow,
        Fairing,
        GemanMcClure,
        GraphFlow,
        HalfQuadratic,
        Heat,
        ImplicitFairing,
        LambdaMu,
        LowCurvature,
        MeanCurvatureDiffusion,
        MinMax,
        NormalChannels,
        NormalFilter,
        PaperScheme,
        Patches,
        PeronaMalik,
        PrincipalFlow,
        Quick,
        RudinOsherFatemi,
        Search,
        SelectiveSmoothing,
        SharedEdges,
        ShockFilter,
        SmallerCurvature,
        TotalVariation,
    )
    from meshflow.flow.steppers import Explicit, SemiImplicit, SuperTime
    from meshflow.flow.stops import AreaLoss, Displacement, Residual, Steps, When
    from meshflow.fusing import fuse
    from meshflow.io.export import to_mesh, to_normals, to_open3d, to_points, to_pyvista
    from meshflow.io.files import Document, read, write
    from meshflow.io.formats.cameras import read_camera, write_camera
    from meshflow.large.outcome import Outcome
    from meshflow.results.expected_error import expected_error
    from meshflow.results.multipart import Results
    from meshflow.results.result import Result
    from meshflow.smoothing import estimate_noise, smooth
    from meshflow.surfaces.camera import Orthographic, Pinhole
    from meshflow.surfaces.curvilinear import Curvilinear
    from meshflow.surfaces.free import Axes, Rays
    from meshflow.surfaces.grid import Lift
    from meshflow.surfaces.height_field import HeightField
    from meshflow.surfaces.image import Image
    from meshflow.surfaces.mesh import Mesh
    from meshflow.surfaces.on_sphere import OnSphere
    from meshflow.surfaces.range_image import RangeImage
    from meshflow.surfaces.scanner import Scanner, Spherical
    from meshflow.surfaces.scattered import Scattered
    from meshflow.surfaces.surface import Surface
    from meshflow.surfaces.tensors import Tensors
    from meshflow.surfaces.tet_mesh import TetMesh
    from meshflow.surfaces.vectors import Vectors
    from meshflow.surfaces.volume import Volume
    from meshflow.viewer.filming import film

_HOMES = {
    "comparing": ("MethodRun", "compare_methods"),
    "errors": (
        "FormatError",
        "InputError",
        "MeshflowWarning",
        "MissingPackage",
        "NotConverged",
    ),
    "estimate.constraints": (
        "DataWeights",
        "Fixed",
        "Mask",
        "MaxChange",
        "MinComponent",
        "Mobility",
        "PreserveArea",
        "PreserveVolume",
    ),
    "estimate.noise": ("Noise",),
    "flow.compute": ("Compute",),
    "flow.controls": (
        "AreaChange",
        "Embedded",
        "FixedStep",
        "Until",
    ),
    "flow.engines.grid": ("GridFlow",),
    "flow.engines.mesh": ("MeshFlow",),
    "flow.engines.tetrahedra": ("TetFlow",),
    "flow.engines.volume": ("VolumeFlow",),
    "flow.march": (
        "State",
        "march",
    ),
    "flow.methods": (
        "Beltrami",
        "ConformalFlow",
        "CurvatureFlow",
        "Fairing",
        "GemanMcClure",
        "GraphFlow",
        "HalfQuadratic",
        "Heat",
        "ImplicitFairing",
        "LambdaMu",
        "LowCurvature",
        "MeanCurvatureDiffusion",
        "MinMax",
        "NormalChannels",
        "NormalFilter",
        "PaperScheme",
        "Patches",
        "PeronaMalik",
        "PrincipalFlow",
        "Quick",
        "RudinOsherFatemi",
        "Search",
        "SelectiveSmoothing",
        "SharedEdges",
        "ShockFilter",
        "SmallerCurvature",
        "TotalVariation",
    ),
    "flow.family": ("Variant",),
    "flow.steppers": (
        "Explicit",
        "SemiImplicit",
        "SuperTime",
    ),
    "flow.stops": (
        "AreaLoss",
        "Displacement",
        "Residual",
        "Steps",
        "When",
    ),
    "fusing": ("fuse",),
    "io.export": (
        "to_mesh",
        "to_normals",
        "to_open3d",
        "to_points",
        "to_pyvista",
    ),
    "io.files": (
        "Document",
        "read",
        "write",
    ),
    "io.formats.cameras": (
        "read_camera",
        "write_camera",
    ),
    "large.outcome": ("Outcome",),
    "results.expected_error": ("expected_error",),
    "results.multipart": ("Results",),
    "results.result": ("Result",),
    "smoothing": (
        "estimate_noise",
        "smooth",
    ),
    "surfaces.camera": (
        "Orthographic",
        "Pinhole",
    ),
    "surfaces.curvilinear": ("Curvilinear",),
    "surfaces.grid": ("Lift",),
    "surfaces.height_field": ("HeightField",),
    "surfaces.image": ("Image",),
    "surfaces.mesh": ("Mesh",),
    "surfaces.on_sphere": ("OnSphere",),
    "surfaces.range_image": ("RangeImage",),
    "surfaces.scanner": (
        "Scanner",
        "Spherical",
    ),
    "surfaces.scattered": ("Scattered",),
    "surfaces.free": ("Axes", "Rays"),
    "surfaces.surface": ("Surface",),
    "surfaces.tensors": ("Tensors",),
    "surfaces.tet_mesh": ("TetMesh",),
    "surfaces.vectors": ("Vectors",),
    "surfaces.volume": ("Volume",),
    "viewer.filming": ("film",),
}
__all__ = sorted(name for names in _HOMES.values() for name in names)  # pyright: ignore[reportUnsupportedDunderAll]

_found, __dir__ = lazily(__name__, _HOMES, rooms=("classics", "evaluate", "synthetic", "view"))


def __getattr__(name: str) -> object:
    """Import a public name on first use; ``__version__`` is the version of the package."""
    return import_module("meshflow.results.result").release() if name == "__version__" else _found(name)
