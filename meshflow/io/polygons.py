"""Polygons are triangulated as fans; a polygon of very many corners would give a vertex with as many neighbours."""

from meshflow.errors import FormatError

__all__ = ["must_be_small"]

# Some quantities of a vertex take time in proportion to the square of its neighbours.
_MOST_CORNERS = 4096


def must_be_small(name: str, corners: int) -> None:
    """Refuse a polygon of too many corners, before the work that would take minutes.

    :param name: of the file.
    :param corners: of its largest polygon.
    :raises FormatError: with the number and the limit.
    """
    if corners > _MOST_CORNERS:
        raise FormatError(
            f"{name}: a polygon of {corners} corners, and {_MOST_CORNERS} is the limit for a fan of triangles; triangulate it "
            "first, for example in MeshLab or Blender"
        )
