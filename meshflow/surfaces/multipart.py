"""Joins several meshes into one."""

from collections.abc import Sequence

import numpy as np

from meshflow.errors import InputError
from meshflow.surfaces.data import Data
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh

__all__ = ["as_one", "together"]


def as_one(parts: Sequence[Data]) -> Data:
    """Bands of one grid as an image, meshes as one mesh.

    :raises InputError: as :func:`together`.
    """
    bands = [one for one in parts if isinstance(one, HeightField)]
    if len(bands) < len(parts) or len({one.z.shape for one in bands}) != 1:
        return together(parts)
    missing = np.any([one.missing for one in bands], axis=0)
    return Image(np.stack([one.z for one in bands], axis=2), bands[0].spacing, missing, period=bands[0].period)


def together(surfaces: Sequence[Data]) -> Mesh:
    """Join meshes into one; their vertices follow each other.

    :raises InputError: for data objects that are no meshes, and for meshes that differ in what moves.
    """
    meshes = [one for one in surfaces if isinstance(one, Mesh)]
    kinds = {
        (one.points.shape[1], one.moves, None if one.channels is None else one.channels.shape[1]) for one in meshes
    }
    if len(meshes) < len(surfaces) or len(kinds) != 1:
        raise InputError("parts that are no meshes of one kind cannot be taken as one; take them one by one")
    starts = np.cumsum([0, *(len(one.points) for one in meshes)])
    channels = [one.channels for one in meshes if one.channels is not None]
    return Mesh(
        np.concatenate([one.points for one in meshes]),
        np.concatenate([one.faces + start for one, start in zip(meshes, starts, strict=False)]),
        np.concatenate(channels) if channels else None,
        moves=meshes[0].moves,
        fixed=np.concatenate([one.fixed for one in meshes]),
    )
