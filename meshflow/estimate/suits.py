"""Which options and methods apply to a kind of data."""

from meshflow.errors import InputError
from meshflow.estimate.request import Request
from meshflow.flow.compute import Compute
from meshflow.flow.methods import words_for
from meshflow.flow.methods.beltrami import Beltrami, HeightMethod, MeanCurvatureDiffusion
from meshflow.flow.methods.graph import GraphFlow
from meshflow.flow.methods.points import PointMethod
from meshflow.flow.methods.searched import Search
from meshflow.surfaces.data import Data
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage

__all__ = ["must_suit", "words_on"]

# Members of the family that are mean curvature flow where points move alone, whatever their exponents.
MEAN_CURVATURE = (Beltrami, MeanCurvatureDiffusion, GraphFlow)


def must_suit(data: Data, request: Request) -> None:
    """Refuse options that do not apply to this kind of data.

    :raises InputError: the message says what applies.
    """
    kind = type(data).__name__
    for word, given in (
        ("MinComponent", request.constraints.min_component is not None),
        ("domain='disparity'", request.domain == "disparity"),
    ):
        if given and not isinstance(data, RangeImage):
            raise InputError(f"{word}: only for range images, got {kind}")
    if request.compute.diagonals != Compute().diagonals and isinstance(data, Mesh):
        raise InputError(
            f"diagonals: only for grids, whose cells are cut into triangles; got {kind}, which has its own triangles"
        )
    if request.level is not None and isinstance(data, (Mesh, RangeImage)):
        raise InputError(f"level: only for height fields and images, got {kind}")
    if request.outliers is not None and (
        isinstance(data, RangeImage) or (isinstance(data, Mesh) and data.moves != "channels")
    ):
        raise InputError(
            f"outliers: of height fields, images and values of vertices only, got "
            f"{'a mesh whose points move' if isinstance(data, Mesh) else kind}"
        )
    if request.domain == "magnitudes":
        raise InputError(f"domain='magnitudes': only for volumes, got {kind}")
    if request.domain == "stabilized" and not isinstance(data, (HeightField, Image)):
        raise InputError(f"domain='stabilized': only for height fields and images, got {kind}")
    if request.compute.triangles == "clamped" and not isinstance(data, Mesh):
        raise InputError(f"triangles: only for meshes, got {kind}")
    _must_be_defined(data, request)
    if isinstance(data, Mesh) and data.moves != "channels":
        _must_bend(data, request)
        return
    of_points = {
        "PreserveVolume and PreserveArea": request.constraints.preserve is not None,
        "triangles": request.compute.triangles not in ("auto", "clamped"),
        "along": getattr(request.method, "along", "all") != "all",
        "boundary='border-curve'": request.boundary == "border-curve",
        f"method={getattr(request.method, 'word', '')!r}": isinstance(request.method, PointMethod),
    }
    for word, given in of_points.items():
        if given:
            what = "a mesh of which the channels move" if isinstance(data, Mesh) else kind
            suits = f"; {_methods_on(data)}" if word.startswith("method") else ""
            raise InputError(f"{word}: only for a mesh whose points move, got {what}{suits}")


def _must_bend(data: Mesh, request: Request) -> None:
    """Refuse points in the plane that move alone: no flow moves them but at a border that is free to shrink.

    :raises InputError: it says what else they may be.
    """
    if data.points.shape[1] == 2 and data.moves == "points" and request.boundary in (None, "plane-preserving", "fixed"):
        raise InputError(
            f"mesh points: shape (n, 3) expected, got {data.points.shape}: a mesh in the plane has no curvature, so nothing "
            "would move; give heights as the third coordinate, or values of its vertices as channels="
        )


def _must_be_defined(data: Data, request: Request) -> None:
    """Refuse a method for values above a base that is not defined on the data.

    :raises InputError: with its name, and the methods that are.
    """
    method, rays = request.method, isinstance(data, RangeImage)
    if not isinstance(method, HeightMethod):
        return
    moving = isinstance(data, Mesh) and data.moves != "channels"
    if isinstance(data, Mesh) and data.moves == "points" and not isinstance(method, (Search, *MEAN_CURVATURE)):
        why = "only for heights, images and channels, got points that move"
    else:
        why = (method.variant if moving else method).misfit(rays, not isinstance(data, Mesh))
    if not why:
        return
    inverse = "; domain='disparity' takes all methods of height fields" if rays else ""
    raise InputError(f"method={method.word!r}: {why}; {_methods_on(data)}{inverse}")


def words_on(data: Data) -> tuple[str, ...]:
    """The names of the methods that are defined on the data."""
    points = isinstance(data, Mesh) and data.moves != "channels"
    return words_for(points, along_rays=isinstance(data, RangeImage), on_grid=not isinstance(data, Mesh))


def _methods_on(data: Data) -> str:
    return f"methods for this data are {', '.join(words_on(data))}"
