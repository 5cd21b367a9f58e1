"""The plan of a run: typed values, each with its origin and reason."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from meshflow.estimate.channel_spikes import ValueSpikes
from meshflow.estimate.noise import Noise
from meshflow.estimate.parameters import Origin
from meshflow.estimate.preparation import Preparation
from meshflow.estimate.request import Request
from meshflow.estimate.risk import Candidate
from meshflow.flow.conservation import Keep
from meshflow.flow.constraints import Hold, Limit
from meshflow.flow.controls import Until
from meshflow.flow.family import Variant
from meshflow.flow.methods import Method
from meshflow.flow.methods.beltrami import HeightMethod
from meshflow.flow.methods.between_voxels import BetweenVoxels
from meshflow.flow.methods.normal_filter import NormalFilter
from meshflow.flow.methods.points import PointMethod, PointSetting
from meshflow.flow.patch_groups import PatchGroups
from meshflow.flow.stops import Scale
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import Data, array_of
from meshflow.surfaces.grid import Grid, Lift, Whole
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.orientation import AS_IT_IS, Orientation
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.volume import Block, Volume, WholeVolume

__all__ = ["GIVEN", "Decided", "Part", "Plan", "size_of"]


@dataclass(frozen=True)
class Decided:
    """The origin of a value, and the reason."""

    origin: Origin = "default"
    why: str = ""


GIVEN = Decided("given")


@dataclass(frozen=True)
class Part:
    """One of several runs that are blended.

    :ivar time: squared length.
    """

    weight: float
    method: HeightMethod
    time: float


@dataclass(frozen=True, eq=False)
class Plan:
    """The plan of a run.

    :ivar data: for the flow; samples that must not move are fixed.
    :ivar request: of the caller.
    :ivar noise: estimated or given.
    :ivar method: with all its numbers.
    :ivar lift: how the data is turned into a surface: contrast, diagonals, boundary.
    :ivar time: squared length; where steps or stops end the run, its latest end.
    :ivar decided: origins and reasons by the names of options.
    :ivar candidates: of the search, the chosen one first.
    :ivar blend: the runs that are blended, the first one is that of ``method`` and ``time``; empty: that alone.
    :ivar idle: why nothing is done; None where something is done.
    :ivar warnings: sentences.
    :ivar mobility: (n, 1), how fast each sample goes; None: all go freely.
    :ivar stays: mask of the samples that the data or the caller fixes; None: of none.
    :ivar max_change: what no sample leaves, a number or an array of the data's samples, unit of the values; None: no limit.
    :ivar pull: of the data weights, (n, k), (n, 1) or (1, 1), per time; None: none.
    :ivar most_pull: the largest data weight of the whole of which ``data`` is a part, per time; None: it is the whole.
    :ivar preserve: what a mesh whose points move keeps.
    :ivar recentred: whether the mean offsets of a mesh from its data along the normals are removed after the run.
    :ivar of_round_parts: the method and the time of a shorter run, of which the round parts of a mesh are taken; None: of none.
    :ivar orientation: how the caller's grid was turned to become ``data``; the request's arrays were turned with it.
    :ivar setting: of a mesh whose points move; None of everything else.
    :ivar groups: the second stage, of groups of similar patches; None: the flow alone.
    :ivar base: (k, h, w), the base of a grid, relative to which it is smoothed; None: zero.
    :ivar preparation: of the samples of a grid before the flow; else None.
    :ivar spikes: of the channels of a mesh, which ``data`` has no more; None: it had none.
    :ivar whole: of the grid, or the volume, of which ``data`` is a window; None: it is the whole.
    """

    data: Data
    request: Request
    noise: Noise
    method: Method
    lift: Lift
    time: float = 0.0
    decided: Mapping[str, Decided] = field(default_factory=dict)
    candidates: tuple[Candidate, ...] = ()
    blend: tuple[Part, ...] = ()
    idle: str | None = None
    warnings: tuple[str, ...] = ()
    mobility: Array | None = None
    stays: Array | None = None
    max_change: Any = None
    pull: Array | None = None
    most_pull: float | None = None
    preserve: Keep | None = None
    recentred: bool = False
    of_round_parts: tuple[NormalFilter, float] | None = None
    orientation: Orientation = AS_IT_IS
    setting: PointSetting | None = None
    base: Array | None = None
    preparation: Preparation | None = None
    groups: PatchGroups | None = None
    spikes: ValueSpikes | None = None
    whole: Whole | WholeVolume | None = None

    @property
    def above(self) -> HeightField | Image | RangeImage:
        """The grid to be smoothed: the data relative to its base.

        :raises TypeError: for a mesh, a volume and tetrahedra, which have no base.
        """
        if isinstance(self.data, (Mesh, TetMesh, Volume)):
            raise TypeError(f"above: a grid expected, got {self.data!r}")
        if self.base is None:
            return self.data
        return self.data.lowered(self.data.gridded(self.lift).planes.reshape(len(self.base), -1).T - self.base_columns)

    @property
    def grid(self) -> Grid | Block:
        """The samples that an engine moves: those of the grid relative to its base, or of the volume.

        :raises TypeError: for a mesh, and tetrahedra.
        """
        return (self.data if isinstance(self.data, Volume) else self.above).gridded(self.lift)

    @property
    def base_columns(self) -> Array:
        """The base as (n, k), zero without one."""
        return np.zeros((1, 1), np.float32) if self.base is None else self.base.reshape(len(self.base), -1).T

    def _lowered(self, u: Array) -> Data:
        """The data at coordinates u (n, k) relative to its base; what did not move does not change in any bit."""
        if self.base is None or isinstance(self.data, (Mesh, RangeImage, TetMesh, Volume)):
            return self.data.lowered(u)
        planes = self.data.gridded(self.lift).planes
        values = planes.reshape(len(planes), -1).T
        stays = self.data.fixed.reshape(-1, 1) | (u == values - self.base_columns)
        return self.data.lowered(np.where(stays, values, u + self.base_columns))

    def result(self, u: Array | None = None) -> Data:
        """The data of the caller with coordinates u (n, k) of the flow; None: for a run that does nothing."""
        done = self.data if u is None else self._lowered(u)
        if isinstance(done, Mesh) and self.spikes is not None:
            return self.spikes.restored(done, u is None)
        if isinstance(done, (Mesh, RangeImage, TetMesh)):
            return done
        done = done if isinstance(done, Volume) else done.oriented(self.orientation.inverse)
        return done if self.preparation is None else self.preparation.restored(done, u is None)

    def with_(self, decided: Mapping[str, Decided], **changes: Any) -> "Plan":
        """The plan with other values, and their origins in addition to those so far."""
        return replace(self, decided={**self.decided, **decided}, **changes)

    def only(self, part: Part) -> "Plan":
        """The run of one part of a blend."""
        lift = replace(self.lift, contrast=part.method.contrast or self.lift.contrast)
        return replace(self, method=part.method, lift=lift, time=part.time, blend=())

    @property
    def variant(self) -> Variant:
        """Exponents, edge indicator and mass, for the engines."""
        if isinstance(self.method, HeightMethod):
            return self.method.variant
        return Variant(mass=getattr(self.method, "mass", "barycentric"))

    @property
    def points(self) -> PointMethod | None:
        """The method for a mesh whose points move; else None."""
        return self.method if isinstance(self.method, PointMethod) else None

    @property
    def twicing(self) -> float:
        """w of u(t) + w (u(t) - u(2 t))."""
        return float(self.method.twicing or 0.0) if isinstance(self.method, HeightMethod) else 0.0

    @property
    def there(self) -> float:
        """The share of the samples that are not missing."""
        return 1.0 if isinstance(self.data, Mesh) else float(np.mean(~self.data.missing))

    @property
    def until(self) -> Until:
        """When to stop."""
        request = self.request
        time = None if request.steps is not None and not request.until_time else self.time
        return Until(time, request.steps, request.stops, scale=self._scale())

    def hold(self, start: Array) -> Hold | None:
        """The limit on all coordinates; of a surface of voxels half of one, unless another one is given.

        :param start: u (n, k) of the flow, before its first step.
        """
        if self.max_change is None and isinstance(self.method, BetweenVoxels) and isinstance(self.data, Mesh):
            return self.method.hold(start, self.data.faces)
        return self.limit(start)

    def limit(self, start: Array) -> Limit | None:
        """The limit on all coordinates.

        :param start: u (n, k) of the flow, before its first step.
        """
        if self.max_change is None:
            return None
        around = isinstance(self.data, Mesh) and self.data.moves == "points"
        return Limit.of(start, self.max_change, size_of(self.data)[0], around)

    def _scale(self) -> Scale:
        """The conversion from the numbers of stops to those of u."""
        shape, n = size_of(self.data)
        k = int(np.prod(shape)) // n
        each = 1.0 if isinstance(self.data, Mesh) and self.data.moves != "channels" else float(np.sqrt(k))
        stays = self.data.fixed if isinstance(self.data, Mesh) else self.data.fixed | self.data.missing
        moving = float(np.mean(~stays)) or 1.0  # stops are not used where nothing may move
        return Scale(self.noise.sigma * self.request.strength * each, moving, _Seen(shape, self))


@dataclass(frozen=True)
class _Seen:
    """Converts u to the values (h, w), (h, w, k) or (n, k) of the caller, read-only."""

    shape: tuple[int, ...]
    plan: Plan

    def __call__(self, u: Array) -> Array:
        values = (np.asarray(u) if self.plan.base is None else u + self.plan.base_columns).reshape(self.shape).view()
        values = self.plan.orientation.inverse.of(values) if self.plan.orientation.changes else values
        values = values if self.plan.preparation is None else self.plan.preparation.seen(values)
        values.flags.writeable = False
        return values


def size_of(data: Data) -> tuple[tuple[int, ...], int]:
    """The shape of the moving coordinates for the caller, and the number of samples."""
    values = array_of(data)
    n = len(data.points) if isinstance(data, Mesh) else data.missing.size
    if isinstance(data, Mesh) and data.moves == "all":
        return (values.shape[0], data.points.shape[1] + values.shape[1]), n
    return values.shape, n
