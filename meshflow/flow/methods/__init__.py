"""The methods, one per file, each with its equation and its options."""

import inspect
import re
from collections.abc import Callable

from meshflow.errors import InputError
from meshflow.flow.methods.beltrami import (
    Beltrami,
    GemanMcClure,
    Heat,
    HeightMethod,
    MeanCurvatureDiffusion,
    Patches,
)
from meshflow.flow.methods.curvature import ConformalFlow, CurvatureFlow
from meshflow.flow.methods.fairing import Fairing
from meshflow.flow.methods.graph import GraphFlow
from meshflow.flow.methods.half_quadratic import HalfQuadratic, RudinOsherFatemi
from meshflow.flow.methods.implicit_fairing import ImplicitFairing
from meshflow.flow.methods.lambda_mu import LambdaMu
from meshflow.flow.methods.lcis import LowCurvature
from meshflow.flow.methods.min_max import MinMax
from meshflow.flow.methods.normal_channels import NormalChannels
from meshflow.flow.methods.normal_filter import NormalFilter
from meshflow.flow.methods.perona_malik import PeronaMalik
from meshflow.flow.methods.points import PointMethod
from meshflow.flow.methods.principal import PrincipalFlow
from meshflow.flow.methods.ring import PaperScheme
from meshflow.flow.methods.searched import Quick, Search
from meshflow.flow.methods.selective import SelectiveSmoothing
from meshflow.flow.methods.shared_edges import SharedEdges
from meshflow.flow.methods.shock import ShockFilter
from meshflow.flow.methods.smaller_curvature import SmallerCurvature
from meshflow.flow.methods.total_variation import TotalVariation
from meshflow.geometry.options import must_be_object, refused, spelled
from meshflow.geometry.validation import shown

__all__ = [
    "HEIGHT_METHODS",
    "METHODS",
    "POINT_METHODS",
    "Method",
    "method_of",
    "no_method",
    "papers_of",
    "word_of",
    "words_for",
]

Method = HeightMethod | PointMethod
# Methods for values above a base (heights, channels, depths), and methods for the points of a mesh.
HEIGHT_METHODS: tuple[type[HeightMethod], ...] = (
    Beltrami, GraphFlow, MeanCurvatureDiffusion, TotalVariation, PeronaMalik, GemanMcClure, Heat, Patches, PaperScheme,
    SelectiveSmoothing, SmallerCurvature, ShockFilter, MinMax, LowCurvature, SharedEdges,
    HalfQuadratic, RudinOsherFatemi,
)  # fmt: skip
POINT_METHODS: tuple[type[PointMethod], ...] = (
    CurvatureFlow, ConformalFlow, Fairing, ImplicitFairing, LambdaMu, NormalFilter, PrincipalFlow, NormalChannels,
)  # fmt: skip
METHODS: dict[str, Callable[[], Method]] = {
    found.word: found for found in (Search, Quick, *HEIGHT_METHODS, *POINT_METHODS)
}

# Methods of other tools, and what corresponds to them here.
ELSEWHERE = {
    "laplacian": "curvature (meshes) or heat (grids)",
    "laplace": "curvature (meshes) or heat (grids)",
    "mean-curvature-flow": "curvature (meshes) or graph (grids)",
    "humphrey": "curvature, and preserve the volume",
    "gaussian": "heat, with a scale",
    "gauss": "heat, with a scale",
    "bilateral": "normal-filter (meshes) or patches (grids)",
    "nlm": "patches",
    "nl-means": "patches",
    "median": "total-variation",
    "tv": "total-variation (a flow) or rof (at rest)",
    "ms96": "graph (graph mean curvature) or min-max",
    "pr99": "meshflow.classics.field_picture (grids) or field_diffusion (surfaces)",
    "preusser-rumpf": "meshflow.classics.field_picture (grids) or field_diffusion (surfaces)",
    "preusser": "meshflow.classics.field_picture (grids) or field_diffusion (surfaces)",
    "lic": "meshflow.classics.field_picture (grids) or field_diffusion (surfaces)",
    "anisotropic": "perona-malik or beltrami",
    "anisotropic-diffusion": "perona-malik or beltrami",
    "windowed-sinc": "fairing (with an order)",
    "two-step": "normal-filter",
}


# Methods by their authors; their keys, such as PM90, are aliases of their own.
AUTHORS = {
    "alvarez": "selective", "alvarez-lions-morel": "selective", "kornprost": "shock", "kornprost-deriche-aubert": "shock",
    "malladi": "min-max", "malladi-sethian": "min-max", "tumblin": "low-curvature", "tumblin-turk": "low-curvature",
    "shah": "shared-edges", "rudin": "rof", "rudin-osher-fatemi": "rof", "el-fallah": "mean-curvature",
    "el-fallah-ford": "mean-curvature", "sochen": "beltrami", "sochen-kimmel-malladi": "beltrami",
    "desbrun": "implicit-fairing", "perona": "perona-malik", "geman": "geman-mcclure",
}  # fmt: skip


def method_of(given: "str | Method") -> Method:
    """The method itself, or the class of a name with its defaults.

    :raises InputError: for an unknown name, and for an object that is no method.
    """
    if isinstance(given, (HeightMethod, PointMethod)):
        return given
    if isinstance(given, str):
        if word := word_of(given):
            return METHODS[word]()
        raise no_method(given)
    must_be_object(given, "method: a method")
    raise InputError(f"method: a name or a method such as PeronaMalik(sharpness=2) expected, got {shown(given)}")


def papers_of(kind: type) -> tuple[str, ...]:
    """The papers that the docstring of a method cites, such as PM90."""
    return tuple(dict.fromkeys(re.findall(r"\[([A-Z][A-Za-z]+\d\d)\]", inspect.getdoc(kind) or "")))


def word_of(given: str) -> str:
    """The name of the method that is meant: by its name in any spelling, by that of its class, or by an alias; else empty."""
    if word := spelled(given, METHODS):
        return word
    letters = "".join(filter(str.isalnum, given)).lower()
    for kind in (*HEIGHT_METHODS, *POINT_METHODS):
        names = (kind.__name__, *kind.aliases)
        if letters in ("".join(filter(str.isalnum, name)).lower() for name in names):
            return kind.word
    return AUTHORS.get(spelled(given, AUTHORS), "")


def no_method(word: str) -> InputError:
    """The error for an unknown method; its message names the one that other tools call so, or the nearest one."""
    if meant := ELSEWHERE.get(word.lower().replace("_", "-").replace(" ", "-"), ""):
        return InputError(f"{word or 'an empty word'}: no such method; use {meant}")
    return refused(word or "an empty word", tuple(METHODS), "method")


def words_for(points: bool, *, along_rays: bool = False, on_grid: bool = True) -> tuple[str, ...]:
    """The names of the methods for points of a mesh, or else of those for values above a base.

    :param along_rays: the values move along rays; ``on_grid``: they are on a grid: only methods that are defined there.
    """
    if points:
        return ("search", "quick", *(found.word for found in POINT_METHODS))
    suiting = (found.word for found in HEIGHT_METHODS if not found().misfit(along_rays, on_grid))
    return ("search", "quick", *suiting)
