"""A grid by windows, one after the other."""

import numpy as np

from meshflow.large.cleaning import bound_over
from meshflow.large.sample import part_of, sample_of
from meshflow.large.source import Held, grown, tiled
from meshflow.large.windows import windowed
from meshflow.surfaces.data import array_of


def by_windows(data, request, sides, enough=1 << 22, side=16):
    """All windows of a grid, one after the other."""
    source = Held(data)
    found = windowed(source.form, sample_of(source, enough, side), request)
    bound = bound_over(found.local, source, request.constraints, at_once=700)
    done = np.full_like(array_of(data), np.nan)
    for window in tiled(source.form.shape, sides):
        outer = grown(window, found.halo, source.form.shape)
        part = part_of(request.constraints, source.form.shape, outer)
        done[window] = bound.moved((window, outer), *source.read(outer), part)
    return done, found


def same(one, other):
    assert np.array_equal(one, other, equal_nan=True), f"{np.nanmax(np.abs(one - other)):.3g}"
