"""Filtering of groups of similar patches of a grid or a volume, which are found in a pilot."""

import ctypes
from typing import Annotated, ClassVar

import numpy as np

from meshflow.kernels.gate import kernel
from meshflow.kernels.parameters import Array, Stop, Struct, read, stop, struct, threads, write

__all__ = ["GroupOptions", "patch_groups"]


class GroupOptions(Struct):
    """Slices and side of a patch, stride of references, reach of members, their number, weight of the distance in position,
    and the assumed share of the noise; of a window where it begins in a larger grid, and the sizes of that (patch_groups.h).
    """

    _fields_: ClassVar = [
        *((name, ctypes.c_int64) for name in ("deep", "side", "stride", "reach", "members")),
        *((name, ctypes.c_double) for name in ("near", "loss")),
        *((name, ctypes.c_int64) for name in ("front", "top", "left", "slices", "rows", "columns")),
    ]


@kernel
def patch_groups(
    values: Annotated[Array, read("T", "k", "z", "h", "w")],
    pilot: Annotated[Array, read("T", "k", "z", "h", "w")],
    missing: Annotated[Array | None, read(np.bool_, "z", "h", "w", optional=True)],
    noise: Annotated[Array, read(np.float64, "d", "d")],
    options: Annotated[GroupOptions, struct(GroupOptions)],
    out: Annotated[Array, write("T", "k", "z", "h", "w", over="pilot")],
    stop: Annotated[Stop | None, stop] = None,
    threads: Annotated[int | None, threads] = None,
) -> None:
    """Filter noisy values in groups of patches: m + C (C + Cn)^-1 (y - m), averaged over the groups of a sample.

    Samples without a group are those of the pilot. A grid of two axes has one slice.

    :param values: (k, z, h, w), in units of their noise, channels of independent noise.
    :param pilot: (k, z, h, w), a first result, in the same units.
    :param missing: (z, h, w), samples that must not be in a patch; None: none.
    :param noise: (d, d), Cn of the d = deep side^2 samples of a patch, 1 on its diagonal.
    :param options: of the groups.
    :param out: (k, z, h, w); it may be the pilot.
    :param stop: stops the work between tiles.
    :param threads: the number of threads.
    """
