"""The samples of a volume that a search uses: all of a small one, cubes of a large one, and a copy for each probe."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from meshflow.estimate.risk import PROBE, Configuration
from meshflow.estimate.roughness import of_every_roughness
from meshflow.estimate.sure import Probed
from meshflow.flow.constraints import Limit
from meshflow.flow.contract import Flow
from meshflow.flow.engines.volume import VolumeFlow
from meshflow.flow.mobility import slowed
from meshflow.geometry.validation import Array
from meshflow.surfaces.volume import Block, WholeVolume

__all__ = ["VolumePiece", "cubes", "piece_of", "probed", "whole_piece"]

# The side of a cube, the number of samples at a cut that are not counted, and the side of the blocks of a whole volume.
SIDE, MARGIN, BLOCK = 24, 3, 16
# The number of cubes from which those that are used are chosen.
POOL = 64

Cube = tuple[slice, slice, slice]


@dataclass(frozen=True, eq=False)
class VolumePiece:
    """Cubes of a volume one after the other, with a slice of missing samples between them.

    :ivar block: the unchanged samples.
    :ivar counted: (m,), row-major indices of the samples that are counted, cube by cube.
    :ivar begins: (g,), index in ``counted`` of the first sample of each cube.
    :ivar sigma: (k, 1, 1, 1), the noise.
    :ivar limit: (k, d, h, w), the largest change of each sample; None: none.
    :ivar speed: (1, d, h, w), the mobility; None: all samples are free.
    """

    block: Block
    counted: Array
    begins: Array
    sigma: Array
    limit: Array | None = None
    speed: Array | None = None


def whole_piece(block: Block, sigma: Array, limit: Array | None, speed: Array | None) -> VolumePiece:
    """A volume as one piece; blocks of it serve as cubes."""
    places = np.ix_(*(np.arange(size) // min(BLOCK, max(2, size // 2)) for size in block.shape))
    label = (places[0] * block.shape[1] + places[1]) * block.shape[2] + places[2]
    counts = ~(block.missing | block.fixed)
    return _piece(block, np.where(counts, label, -1), sigma, limit, speed)


def cubes(block: Block, count: int) -> list[Cube]:
    """About ``count`` cubes of a volume, of every roughness; those with less than half of their samples free are left out."""
    sides = [min(SIDE, size) for size in block.shape]
    room = np.array(block.shape) / sides
    free, found = ~(block.missing | block.fixed), []
    for more in (1, 3, 9):
        numbers = np.clip(np.rint(room * (more * max(count, POOL) / room.prod()) ** (1 / 3)), 1, np.ceil(room)).astype(
            int
        )
        starts = [
            np.unique(np.clip((np.arange(n) + 0.5) * size / n - 0.5 * side, 0, size - side).astype(int))
            for size, side, n in zip(block.shape, sides, numbers, strict=True)
        ]
        found = [
            (slice(z, z + sides[0]), slice(y, y + sides[1]), slice(x, x + sides[2]))
            for z in starts[0].tolist()
            for y in starts[1].tolist()
            for x in starts[2].tolist()
        ]
        found = [cube for cube in found if free[cube].mean() >= 0.5]
        if 2 * len(found) >= count:
            break
    return of_every_roughness(found, count, lambda cube: (block.planes[(slice(None), *cube)], block.missing[cube]))


def piece_of(
    block: Block, parts: Sequence[Cube], sigma: Array, limit: Array | None, speed: Array | None
) -> VolumePiece:
    """Cubes of a volume, all of one size, as one piece."""
    whole = WholeVolume(block.ends, tuple(first for first, _ in block.spans), block.ragged)
    missing, label = [], []
    for i, cube in enumerate(parts):
        counts = ~(block.missing | block.fixed)[cube]
        for axis, (part, size) in enumerate(zip(cube, block.shape, strict=True)):
            along = np.moveaxis(counts, axis, 0)
            along[: MARGIN if part.start > 0 else 0] = False
            along[len(along) - (MARGIN if part.stop < size else 0) :] = False
        missing.append(block.missing[cube])
        label.append(np.where(counts, i, -1))
    joined = Block(
        _stacked([block.planes[(slice(None), *cube)] for cube in parts], 0.0),
        _stacked(missing, True),
        _stacked([block.fixed[cube] for cube in parts], False),
        block.spacing,
        block.contrast,
        block.diagonals,
        block.boundary,
        whole if block.diagonals == "alternate" else None,
    )
    limits = None if limit is None else _stacked([limit[(slice(None), *cube)] for cube in parts], 0.0)
    speeds = None if speed is None else _stacked([speed[(slice(None), *cube)] for cube in parts], 0.0)
    return _piece(joined, _stacked(label, -1), sigma, limits, speeds)


def _piece(block: Block, label: Array, sigma: Array, limit: Array | None, speed: Array | None) -> VolumePiece:
    """A piece whose counted samples have a label of 0 or more, that of their cube."""
    flat = label.ravel()
    order = np.argsort(flat, kind="stable")
    order = order[flat[order] >= 0]
    begins = np.flatnonzero(np.diff(flat[order], prepend=-1))
    return VolumePiece(block, order, begins, sigma, limit, speed)


def _stacked(parts: Sequence[Array], between: float) -> Array:
    """Arrays (..., d, h, w) one after the other along their slices, with one slice of a value between them."""
    made: list[Array] = []
    for part in parts:
        made += [part, np.full((*part.shape[:-3], 1, *part.shape[-2:]), between, part.dtype)]
    return np.concatenate(made[:-1], axis=-3)


@dataclass(frozen=True, eq=False)
class _Behind:
    """Copies of a piece one after the other.

    :ivar places: (c, m), indices of the samples that are counted, in each copy.
    :ivar limit: (n, k); ``speed``: (n, 1).
    """

    block: Block
    places: Array
    limit: Array | None
    speed: Array | None

    def flow(self, configuration: Configuration) -> tuple[Flow, Limit | None]:
        """The flow with one thread, because several runs go on at once, and the limit of their changes."""
        engine = VolumeFlow(replace(self.block, contrast=configuration.contrast), configuration.variant, 1)
        start = engine.start()
        limit = None if self.limit is None else Limit(start, self.limit.astype(start.dtype))
        return slowed(engine, self.speed), limit


def probed(piece: VolumePiece, probes: Array) -> Probed:
    """A piece with its probes.

    :param probes: (p, k, d, h, w), of deviation 1, correlated like the noise.
    """
    block, noise = piece.block, (PROBE * piece.sigma).astype(piece.block.planes.dtype)
    planes, (d, h, w), count = block.planes, block.shape, 1 + len(probes)
    starts = [planes, *(planes + noise * probe.astype(planes.dtype) for probe in probes)]
    wide = replace(
        block,
        planes=_stacked(starts, 0.0),
        missing=_stacked([block.missing] * count, True),
        fixed=_stacked([block.fixed] * count, False),
        whole=WholeVolume(block.ends, tuple(first for first, _ in block.spans), block.ragged),
    )
    places = piece.counted + (d + 1) * h * w * np.arange(count)[:, None]
    copies = _Behind(wide, places, _columns(piece.limit, count), _columns(piece.speed, count))
    at = probes.reshape(*probes.shape[:2], -1)[..., piece.counted].astype(planes.dtype)
    each = np.broadcast_to(piece.sigma.reshape(-1, 1).astype(np.float64), (len(planes), 1))
    return Probed((copies,), piece.begins, at, each)


def _columns(array: Array | None, count: int) -> Array | None:
    """``count`` copies of an array (k, d, h, w) one after the other, as (n, k)."""
    return None if array is None else _stacked([array] * count, 0.0).reshape(len(array), -1).T
