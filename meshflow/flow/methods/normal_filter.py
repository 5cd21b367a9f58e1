"""The normal filter: the normals of the triangles are smoothed, and the points are fitted to them."""

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from meshflow.errors import InputError
from meshflow.flow.blend import RATE, Blend, euler
from meshflow.flow.contract import Flow, System
from meshflow.flow.controls import Control, LongerLater
from meshflow.flow.engines.dense import Dense
from meshflow.flow.methods.points import PointSetting, Regularizable
from meshflow.flow.regularization import Regularizing
from meshflow.flow.steppers import Explicit, Stepper, StepperName
from meshflow.geometry import normals as facets
from meshflow.geometry import operator
from meshflow.geometry.connectivity import connect
from meshflow.geometry.nearness import nearest_first
from meshflow.geometry.options import named_fields, option
from meshflow.geometry.validation import Array, positive
from meshflow.kernels.conjugate_gradients import pack_vectors
from meshflow.surfaces.surface import Surface

__all__ = ["ROUND", "NormalFilterFlow", "NormalFilter"]

# One round, in squared edges: the normals diffuse in steps of SWEEP, then the points follow in FOLLOWED sweeps. A round is long,
# so that the normals of noisy triangles settle before any point moves. After EARLY, when they have settled, rounds are LATER with
# somewhat more sweeps of the points: with 10 less is smoothed, and in proportion to the time fillets become facets (114 cases:
# normals 0.99 times as far off as with short rounds to the end, at worst 1.05).
ROUND, SWEEP, FOLLOWED = 10.0, 0.5, 10
EARLY, LATER, FOLLOWED_LATER = 100.0, 25.0, 12
# The relative rounding error of a time.
ALMOST = 1e-9


@named_fields
@dataclass(frozen=True, kw_only=True)
class NormalFilter(Regularizable):
    """The normals of the triangles are smoothed, except across creases, and the points are fitted to them.

    Use it for scans and machine parts: creases stay.
    """

    word: ClassVar[str] = "normal-filter"
    conserves: ClassVar[str] = "nothing exactly; shapes hardly shrink"

    crease_contrast: float | None = option(
        None,
        "Two neighbouring unit normals form a crease if their difference times this is above 1. Without a search: 2.",
    )
    crease_sharpness: float | None = option(
        None,
        "How sharply creases are separated from smooth parts: exponent q of the flux of normals, (1 + |contrast dn|²)^(-q/2) "
        "dn. 2 is Perona and Malik, 8 almost a cutoff. Without a search: 8.",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("crease_contrast", "crease_sharpness"):
            if getattr(self, name) is not None:
                positive(getattr(self, name), name)

    def filled(self) -> "NormalFilter":
        """The method with the fixed choice for options that are None."""
        return replace(
            self,
            crease_contrast=2.0 if self.crease_contrast is None else float(self.crease_contrast),
            crease_sharpness=8.0 if self.crease_sharpness is None else float(self.crease_sharpness),
            regularize=0.0 if self.regularize is None else float(self.regularize),
        )

    def engine(self, surface: Surface, setting: PointSetting) -> Flow:
        """The engine that moves the points (n, 3).

        :raises InputError: for clamped triangles, and a border that moves as a curve.
        """
        if setting.triangles == "clamped":
            raise InputError("triangles='clamped': the normal filter uses no cotangents; leave it out")
        self.must_hold_border(setting)
        return NormalFilterFlow(surface, self)

    def states(self, flow: Flow, start: Array, times: tuple[float, ...]) -> Iterator[Array]:
        """The coordinates (n, 3) at each of the times, with steps as in a run."""
        u, since, count = start, 0.0, 0
        for time in times:
            while time - since > ALMOST * time:
                longest = 2.0 / flow.bound(u)
                early = since < (1.0 - ALMOST) * EARLY / LATER * longest
                dt = min(longest * ROUND / LATER if early else longest, time - since)
                u, since, count = flow.rate(u, count, euler(dt)), since + dt, count + 1
            yield u

    def stepper(
        self, asked: Stepper | StepperName, flow: Flow, time: float | None, faces: Array
    ) -> Stepper | StepperName:
        """Explicit rounds.

        :raises InputError: for another stepper by name.
        """
        return self.along_which(self.own_stepper(asked, Explicit()), faces)

    def control(self, asked: Control | None, time: float | None) -> Control | None:
        """The requested control, or longer rounds after a time."""
        return LongerLater(ROUND / LATER, EARLY / LATER) if asked is None else asked


class NormalFilterFlow(Dense):
    """The normal filter as a flow: the normals of triangles diffuse for a time but for creases, and the points are fitted.

    Planes do not move. Points move along normals only (except for ``regularize``). Volume and creases are kept. The flow of
    normals is that of [Tasdizen et al. 2002], on the triangles themselves.

    :param surface: in R^3, all coordinates free.
    :raises InputError: for another surface.
    """

    patience = np.inf
    pace = 1.0

    def __init__(self, surface: Surface, how: NormalFilter | None = None) -> None:
        if not surface.is_free or surface.points.shape[1] != 3:
            raise InputError("normal-filter: a mesh in R^3 whose points move expected")
        self.surface, self.how = surface, (how or NormalFilter()).filled()
        self.connectivity = connect(surface.triangulations, len(surface.points))
        self.step = facets.mean_edge(surface.points, self.connectivity.faces)
        held = surface.fixed.copy()
        if surface.boundary == "fixed":
            held |= self.connectivity.rim
        self._order, faces = nearest_first(surface.points, self.connectivity.faces)
        self._near, self._held = self.connectivity, held
        if self._order is not None:
            self._near, self._held = connect((faces,), len(surface.points)), held[self._order]
        self._across = facets.beyond(self._near.faces)
        self._ones = np.ones(len(surface.points))

    def of(self, how: NormalFilter) -> "NormalFilterFlow":
        """The flow of another normal filter on the same surface."""
        other = copy(self)
        other.how = how.filled()
        return other

    def rate(self, u: Array, diagonal: int = 0, blend: Blend = RATE, out: Array | None = None) -> Array:
        """The mean rate of a round; with a blend that keeps u, the normals diffuse for its dt and the points follow once."""
        round = blend.dt if blend.keep != 0.0 else ROUND * self.step**2
        x, change = np.empty((len(u), 3)), -u.astype(np.float64, copy=False)
        pack_vectors(self._order, self._ones, np.ascontiguousarray(u, dtype=np.float64), x, 0)
        pack_vectors(self._order, self._ones, self._moved(x, round, diagonal == 0), change, 1)
        if blend.keep == 0.0:
            return blend.of_rate(u, change / round, out)
        return blend.of_change(u, change, out)

    def _moved(self, x: Array, dt: float, first: bool) -> Array:
        """The points (n, 3) after a round, in the order of the loops; x (n, 3) is written to."""
        how, faces = self.how, self._near.faces
        if first and (how.regularize or 0.0) > 0:
            x = Regularizing(self._near, self.step, np.where(self._held, 0.0, 1.0), how.regularize or 0.0).of(x)
        normals, areas = facets.measured(x, faces)
        weights, room = facets.conductances(x, faces, self._across), np.empty_like(normals)
        sweeps = max(1, round(dt / (SWEEP * self.step**2)))
        contrast, sharpness = how.crease_contrast or 2.0, how.crease_sharpness or 8.0
        by = facets.NormalDiffusion(areas, weights, self._across, contrast, sharpness)
        normals = facets.spread(normals, by, dt / sweeps, sweeps, room)
        follow = FOLLOWED if dt <= (1.0 + ALMOST) * ROUND * self.step**2 else FOLLOWED_LATER
        return facets.followed(x, self._near, normals, self._held, follow, (np.empty_like(x), weights))

    def area(self, u: Array) -> float:
        """Area of the surface, squared length."""
        return operator.total_area(u, self.connectivity.faces)

    def bound(self, u: Array) -> float:
        """The bound that makes one explicit step a round of the longer ones."""
        return 2.0 / (LATER * self.step**2)

    def system(self, u: Array, diagonal: int = 0) -> System:
        """Not available.

        :raises InputError: always, because the flow of normals has no matrix.
        """
        raise InputError("normal-filter: it is computed in explicit rounds; leave the stepper out")
