"""A grid by windows, one after the other."""

from dataclasses import dataclass
from pathlib import Path
from tempfile import gettempdir

import numpy as np

from meshflow.large.cleaning import bound_over
from meshflow.large.memory import Budget, Room
from meshflow.large.sample import part_of, sample_of
from meshflow.large.source import Held, grown, tiled
from meshflow.large.step_lengths import lengths_by_all
from meshflow.large.stopping import stopped_by_all
from meshflow.large.windows import Begun, windowed
from meshflow.surfaces.data import array_of
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.volume import Volume

# The shapes of a terrain and of a volume.
H, W = 61, 47
SHAPE = 17, 21, 14


def terrain(h=H, w=W, dtype=np.float32, seed=0, holes=0.03, rows=False, level=0.0, k=0):
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[0:h, 0:w]
    z = level + 4 * np.sin(y / 7) * np.cos(x / 5) + 6 * (x > w // 2) + rng.normal(size=(h, w))
    missing = rng.random((h, w)) < holes
    if holes:
        missing[h // 3 : h // 2, : w // 3] = True
    if k:
        return Image(np.stack([z + i * rng.normal(size=(h, w)) for i in range(k)], 2).astype(dtype), missing=missing)
    spacing = (np.linspace(1.0, 1.4, h), 1.2) if rows else (1.3, 0.8)
    return HeightField(z.astype(dtype), spacing, missing)


def volume(shape=SHAPE, dtype=np.float32, seed=0, holes=0.03, level=0.0, k=0):
    rng = np.random.default_rng(seed)
    z, y, x = np.mgrid[tuple(slice(size) for size in shape)]
    values = level + 4 * np.sin(z / 5) * np.cos(y / 4) + 6 * (x > shape[2] // 3) + rng.normal(size=shape)
    missing = rng.random(shape) < holes
    if holes:
        missing[shape[0] // 3 : shape[0] // 2, :5] = True
    if k:
        values = np.stack([values + i * rng.normal(size=shape) for i in range(k)], axis=3)
    return Volume(values.astype(dtype), (1.0, 0.8, 1.3), missing, unit="mm")


@dataclass(frozen=True)
class Sized(Budget):
    """Windows of given sides."""

    given: tuple[int, ...] = ()

    def sides(self, form, halo, held=0):
        return self.given


def by_windows(data, request, sides, enough=1 << 22, side=16, legs=1):
    """All windows of a grid, one after the other; in several legs the state lies in arrays between them."""
    source = Held(data)
    found = windowed(source.form, sample_of(source, enough, side), request)
    bound = bound_over(found.local, source, request.constraints, at_once=700)
    folder = Path(gettempdir())
    room = Room(Sized(1e9, sides), folder)
    found, bound = lengths_by_all(found, bound, source, request, room)
    found, bound = stopped_by_all(found, bound, source, request, room)
    shape, cut = source.form.shape, found.local.legs
    *before, last = cut.cut(cut.beside + (cut.halo - cut.beside) / legs)
    held = {}
    for leg in before:
        made = {}
        for window in tiled(shape, sides):
            outer = grown(window, leg.halo, shape)
            part = part_of(request.constraints, shape, outer)
            begun = Begun(leg, {name: array[outer] for name, array in held.items()})
            for name, array in bound.held((window, outer), *source.read(outer), part, begun).items():
                made.setdefault(name, np.zeros((*shape, array.shape[-1]), array.dtype))[window] = array
        held = made
    done = np.full_like(array_of(data), np.nan)
    for window in tiled(shape, sides):
        outer = grown(window, last.halo, shape)
        part = part_of(request.constraints, shape, outer)
        begun = Begun(last, {name: array[outer] for name, array in held.items()})
        done[window] = bound.moved((window, outer), *source.read(outer), part, begun)
    return done, found


def same(one, other):
    assert np.array_equal(one, other, equal_nan=True), f"{np.nanmax(np.abs(one - other)):.3g}"
