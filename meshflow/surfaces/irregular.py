"""Samples whose places are no regular grid: the mesh that they span, whose channels move, and the way back."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError, NothingThere
from meshflow.geometry.validation import Array, mask_of, real
from meshflow.surfaces.mesh import Mesh

__all__ = ["Irregular", "Vertices", "present", "used"]


@dataclass(frozen=True, eq=False)
class Vertices:
    """Which samples are the vertices of a mesh.

    :ivar home: (n,), the vertex of each sample; -1: it is missing.
    :ivar first: (v,), the first sample of each vertex; samples at one place are one vertex.
    """

    home: Array
    first: Array

    @classmethod
    def of(cls, missing: Array, place: Array | None = None) -> "Vertices":
        """The vertices of samples.

        :param missing: (n,).
        :param place: (n,), the number of the place of each sample; None: all are at places of their own.
        """
        there = np.flatnonzero(~missing)
        home = np.full(len(missing), -1)
        if place is None:
            home[there] = np.arange(len(there))
            return cls(home, there)
        _, first, which = np.unique(place[there], return_index=True, return_inverse=True)
        order = np.argsort(first)  # of appearance
        home[there] = np.argsort(order)[which.reshape(-1)]
        return cls(home, there[first[order]])

    def means(self, values: Array) -> Array:
        """The values (v, k) of the vertices of those (n, k) of the samples: the means of samples at one place."""
        there = self.home >= 0
        if there.sum() == len(self.first):
            return values[self.first]
        total = np.zeros((len(self.first), values.shape[1]))
        np.add.at(total, self.home[there], values[there])
        return (total / np.bincount(self.home[there])[:, None]).astype(values.dtype)

    def back(self, values: Array, smoothed: Array) -> Array:
        """The values (n, k) of the samples with those (v, k) of the vertices; missing samples keep theirs."""
        after = values.astype(smoothed.dtype)
        there = self.home >= 0
        after[there] = smoothed[self.home[there]]
        return after


class Irregular(ABC):
    """Values at places that are no regular grid.

    :ivar shape: of the samples, (n,) or (h, w).
    """

    @property
    @abstractmethod
    def shape(self) -> tuple[int, ...]:
        """The shape of the samples: (n,) or (h, w)."""

    @property
    @abstractmethod
    def columns(self) -> Array:
        """The values (n, k) of the samples in a row."""

    @cached_property
    def vertices(self) -> Vertices:
        """Which samples are vertices of the mesh."""
        return self.found()

    @cached_property
    def mesh(self) -> Mesh:
        """The mesh that the samples span; its channels move."""
        return self.spanned()

    @abstractmethod
    def found(self) -> Vertices:
        """Find the samples that are vertices of the mesh."""

    @abstractmethod
    def spanned(self) -> Mesh:
        """Make the mesh."""

    @abstractmethod
    def with_columns(self, columns: Array) -> Self:
        """A copy with other values (n, k)."""

    def holding(self, mesh: Mesh) -> Self:
        """A copy with the values of a smoothed mesh; missing samples keep theirs.

        :raises InputError: for another mesh than that of these samples.
        """
        if mesh.channels is None or len(mesh.channels) != len(self.vertices.first):
            raise InputError(
                f"holding: a mesh of {len(self.vertices.first)} vertices with channels expected, got {mesh!r}"
            )
        return self.with_columns(self.vertices.back(self.columns, mesh.channels))

    def aligned(self, given: ArrayLike | None) -> ArrayLike | None:
        """An option of one number per sample in the order of the vertices; anything else unchanged."""
        values = np.asarray(given)
        if values.shape != self.shape or values.ndim == 0:
            return given
        return values.reshape(-1)[self.vertices.first]

    def __repr__(self) -> str:
        gone, (n, k) = int((self.vertices.home < 0).sum()), self.columns.shape
        size = f"{n} points" if len(self.shape) == 1 else " x ".join(map(str, self.shape))
        channels = f" x {k} channels" if k > 1 else ""
        return f"{type(self).__name__}({size}{channels} {self.columns.dtype}, {gone} missing)"


def present(values: ArrayLike, places: Array, missing: ArrayLike | None, what: str) -> tuple[Array, Array]:
    """Values as floating point, and the samples that are missing: NaN or infinite in a channel or a coordinate, masked, or given.

    :param values: (*shape) or (*shape, k).
    :param places: (*shape, d).
    :param missing: (*shape), further ones.
    :param what: the data, for messages.
    :raises InputError: for values of another shape, and where all are missing.
    """
    shape = places.shape[:-1]
    array = real(np.ma.getdata(values), what)
    if array.shape[: len(shape)] != shape or array.ndim not in (len(shape), len(shape) + 1) or array.size == 0:
        words = ", ".join(map(str, shape))
        raise InputError(
            f"{what}: values of shape ({words}) or ({words}, k) expected, as the places have, got {array.shape}"
        )
    gone: Array = np.logical_not(np.isfinite(places).all(axis=-1) & np.isfinite(array.reshape(*shape, -1)).all(axis=-1))
    if isinstance(values, np.ma.MaskedArray):
        gone |= np.ma.getmaskarray(values).reshape(*shape, -1).any(axis=-1)
    gone |= mask_of(missing, shape, "missing")
    if gone.all():
        raise NothingThere(f"{what}: all {gone.size} samples are missing (NaN, infinite or masked); nothing to smooth")
    return array, gone


def used(faces: Array, points: Array, channels: Array, what: str) -> Mesh:
    """The mesh of triangles that a limit may have left.

    :raises InputError: where it has left none.
    """
    if not len(faces):
        raise InputError(
            f"{what}: at least one triangle expected, the largest edge, the outline or missing samples leave none"
        )
    return Mesh(points, faces, channels)
