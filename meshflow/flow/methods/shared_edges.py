"""One edge field for all channels: curve evolution and segmentation of colour images [Sha96]."""

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

from meshflow.errors import InputError
from meshflow.flow.contract import Flow
from meshflow.flow.engines.samples import SampleFlow, Samples
from meshflow.flow.methods.beltrami import SchemeMethod
from meshflow.geometry.options import named_fields, option
from meshflow.geometry.validation import Array, number, positive
from meshflow.surfaces.grid import Grid

__all__ = ["SharedEdges", "SharedEdgesScheme"]


@dataclass(frozen=True)
class SharedEdgesScheme:
    """The rate of :class:`SharedEdges`, lengths in samples.

    :ivar contrast: of the edge field; ``fidelity``: beta, per squared length; ``width``: rho; ``power``: of the gradients, 1 or
        2.
    """

    contrast: float
    fidelity: float
    width: float
    power: int

    def rate(self, samples: Samples, start: Samples) -> Array:
        """du/dt with the edge field of these values."""
        dx, dy = samples.spacing
        clear = samples.of(np.square(self.edges(samples))[None])
        total = -self.fidelity * (samples.values - start.values)
        for down, right, step in ((0, 1, dx), (0, -1, dx), (1, 0, dy), (-1, 0, dy)):
            link = 0.5 * (clear.values + clear.at(down, right))
            total = total + link * (samples.at(down, right) - samples.values) / step**2
        return total

    def edges(self, samples: Samples) -> Array:
        """v (h, w): 1 in smooth parts and towards 0 at edges; rho v'' + (1 - v) / rho = 2 contrast^p S v, with rest."""
        dx, dy = samples.spacing
        x, y = samples.slopes()
        steep = np.sqrt(self.contrast**2 * (x**2 + y**2).sum(axis=0)) ** self.power
        rho, (h, w) = self.width * np.sqrt(dx * dy), samples.there.shape
        index, n = np.arange(h * w).reshape(h, w), h * w
        parts, diagonal = [], 1.0 / rho + 2.0 * steep.ravel() / rho
        for near, far, step in (
            ((slice(None), slice(0, -1)), (slice(None), slice(1, None)), dx),
            ((slice(0, -1), slice(None)), (slice(1, None), slice(None)), dy),
        ):
            i, j = index[near].ravel(), index[far].ravel()
            weight = rho / step**2 * (samples.there[near] & samples.there[far]).ravel()
            parts += [(i, j, -weight), (j, i, -weight)]
            diagonal = diagonal + np.bincount(i, weight, n) + np.bincount(j, weight, n)
        rows, columns, entries = (np.concatenate(part) for part in zip(*parts, strict=True))
        matrix = sparse.csc_matrix((entries, (rows, columns)), shape=(n, n)) + sparse.diags(diagonal, format="csc")
        return splu(sparse.csc_matrix(matrix)).solve(np.full(n, 1.0 / rho)).reshape(h, w)

    def fastest(self, spacing: tuple[float, float]) -> float:
        """That of the heat equation, and of the fidelity."""
        dx, dy = spacing
        return 4.0 / dx**2 + 4.0 / dy**2 + self.fidelity

    def reach(self, samples: Samples, start: Samples) -> None:
        """Any value: weights of links are none below zero, so that the range is kept as it is."""


@named_fields
@dataclass(frozen=True, kw_only=True)
class SharedEdges(SchemeMethod):
    """Diffusion that one edge field v stops in all channels at once, after Mumford and Shah [Sha96].

    u_k,t = div(v^2 grad u_k) - fidelity (u_k - g_k), and v_t = rho div grad v + (1 - v) / rho - 2 v S, with S = sum |grad u_k|^2
    (power 2) or its root (power 1, Shah's), u in units of 1 / contrast: J. Shah, ICIP 1996, 461-464, as surveys
    give it; the paper itself was not at hand. Here v is at rest for the present u, the limit of a fast v, and S is
    counted in 1 / rho, so that the threshold does not depend on rho. Use it for colours whose edges are in different channels.
    """

    word: ClassVar[str] = "shared-edges"
    conserves: ClassVar[str] = "the mean of the samples, of each channel"
    aliases: ClassVar[tuple[str, ...]] = ("sha96",)

    fidelity: float = option(
        0.0, "How strongly the result is pulled back to the input. 0: not at all.", "1 / squared length"
    )
    width: float = option(2.0, "Width of edges (rho).", "samples")
    power: Literal[1, 2] = option(1, "Power of the gradients in the edge field. 1 is Shah's.", flag="-")

    def __post_init__(self) -> None:
        super().__post_init__()
        positive(self.width, "width")
        if number(self.fidelity, "fidelity") < 0:
            raise InputError(f"fidelity: a number, zero or more, expected, got {self.fidelity}")
        if self.power not in (1, 2):
            raise InputError(f"power: 1 or 2 expected, got {self.power}")

    def on_grid(self, grid: Grid, threads: int | None) -> Flow:
        """The scheme."""
        return SampleFlow(
            grid, SharedEdgesScheme(grid.contrast, self.fidelity, self.width, self.power), self.word, threads
        )
