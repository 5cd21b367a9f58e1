"""Level regions: lakes and levelled tops of quantised heights, as opposed to the steps of slopes; exact ones beside noise."""

from typing import Literal

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion, distance_transform_edt, find_objects
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from meshflow.geometry.validation import Array

__all__ = ["LEVEL_REACH", "Level", "level_of", "level_rule", "plateaus_of"]

# A plateau is kept if it has this width (samples from its middle to its shore) and this size, if this share of its neighbours
# is on one side of it (above or below), and if it is so many times wider than the next step within BESIDE samples.
WIDTH, SIZE, ONE_SIDED, MUCH_WIDER, BESIDE = 4, 100, 0.9, 2.0, 40
# The shore of a plateau, as a share of the width of the next step.
SHORE = 0.4
# Values that are not quantised are level by intention where all samples of a square of this side are equal; unless this share of
# the other neighbours is equal, too, as those of coarse steps are. So are equal samples up to so many steps from the squares.
SQUARE, BY_CHANCE, STEPS = 4, 0.1, 12
# Where at most this share of neighbours is equal by chance, three equal ones are no chance.
HARDLY = 1e-4
# So far from a sample lies what decides whether it is level.
LEVEL_REACH = SQUARE - 1 + STEPS
# Neighbours in rows and columns, and those and both diagonals.
_NEIGHBOURS = ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:]))
_EVERY = (*_NEIGHBOURS, (np.s_[:-1, :-1], np.s_[1:, 1:]), (np.s_[:-1, 1:], np.s_[1:, :-1]))


Level = Literal["", "squares", "pieces"]


def level_rule(values: Array, missing: Array, *, narrow: bool) -> Level:
    """What is taken for level: nothing where many neighbours are equal, as those of coarse steps and of drawings are.

    :param values: (h, w) or (h, w, k); ``missing``: (h, w).
    :param narrow: whether rivers and ponds count, too, where two equal neighbours are hardly ever chance.
    """
    equals = _equal(values, missing)
    if not any(same.any() for same in equals):
        return "pieces" if narrow else "squares"
    squares, pieces = _squares(*equals[:2]), _pieces(equals, missing.shape)
    free = ~(missing | squares)
    pairs, equal, alone = 0, 0, 0
    for same, (one, two) in zip(equals, _EVERY, strict=True):
        both = free[one] & free[two]
        pairs += int(both.sum())
        equal += int((both & same).sum())
        alone += int((both & same & ~(pieces[one] & pieces[two])).sum())
    if equal >= BY_CHANCE * max(pairs, 1):
        return ""
    return "pieces" if narrow and alone <= HARDLY * pairs else "squares"


def level_of(values: Array, missing: Array, rule: Level) -> Array:
    """Mask (h, w) of what is exactly level: lakes, rivers, the sea, empty background.

    ``squares``: squares of equal values, which noise does not leave, and equal ones around them; ``pieces``: three and more
    equal neighbours. Both can be told from a sample's surroundings alone, so that windows of a grid find the same as the whole.

    :param values: (h, w) or (h, w, k), all channels must be equal; ``missing``: (h, w).
    """
    equals = _equal(values, missing)
    return _pieces(equals, missing.shape) if rule == "pieces" else _squares(*equals[:2])


def _equal(values: Array, missing: Array) -> tuple[Array, ...]:
    """Where neighbours in a row (h, w - 1), in a column (h - 1, w), and along both diagonals are equal and present."""
    return tuple(_alike(values[one], values[two]) & ~(missing[one] | missing[two]) for one, two in _EVERY)


def _pieces(equals: tuple[Array, ...], shape: tuple[int, ...]) -> Array:
    """The samples (h, w) of pieces of three and more equal neighbours."""
    count = np.zeros(shape, np.uint8)
    for same, (one, two) in zip(equals, _EVERY, strict=True):
        count[one] += same
        count[two] += same
    middle = count >= 2
    found = middle.copy()
    for same, (one, two) in zip(equals, _EVERY, strict=True):
        found[one] |= middle[two] & same
        found[two] |= middle[one] & same
    return found


def _squares(along: Array, down: Array) -> Array:
    """The samples (h, w) of squares of equal values, and of equal ones around them."""
    h, w = along.shape[0], down.shape[1]
    level = np.zeros((h, w), bool)
    if min(h, w) < SQUARE:
        return level
    rows = along[:, :-2] & along[:, 1:-1] & along[:, 2:]
    left = down[:, : w - 3]
    corners = rows[:-3] & rows[1:-2] & rows[2:-1] & rows[3:] & left[:-2] & left[1:-1] & left[2:]
    if not corners.any():
        return level
    for row in range(SQUARE):
        for column in range(SQUARE):
            level[row : row + h - 3, column : column + w - 3] |= corners
    return _grown(level, along, down)


def _grown(level: Array, along: Array, down: Array) -> Array:
    """A level region with the equal samples that so many steps reach.

    :param along: (h, w - 1), where neighbours in a row are equal; ``down``: (h - 1, w), in a column.
    """
    for _ in range(STEPS):
        grown = level.copy()
        grown[:, 1:] |= level[:, :-1] & along
        grown[:, :-1] |= level[:, 1:] & along
        grown[1:] |= level[:-1] & down
        grown[:-1] |= level[1:] & down
        if np.array_equal(grown, level):
            break
        level = grown
    return level


def _alike(one: Array, two: Array) -> Array:
    """Where values (h, w) or (h, w, k) are equal, in all channels."""
    same = one == two
    return same if same.ndim == 2 else same.all(axis=2)


def plateaus_of(values: Array, missing: Array, quantum: float) -> Array:
    """Mask (h, w) of level regions that are kept: lakes, and levelled tops.

    Such a region is wide, and nearly all of its neighbours are above it, or nearly all below it; a step of a slope has higher
    neighbours on one side and lower ones on the other. It is also much wider than the next step: the rounded bottom of a bowl is
    1.4 times as wide as that, one that was levelled half a step above its bottom three times.
    """
    numbers = _level_regions(values, missing)
    core = binary_erosion(_within(numbers), iterations=WIDTH - 1, border_value=1)
    sizes = np.bincount(numbers[~missing])
    wide = np.zeros(len(sizes), bool)
    wide[np.unique(numbers[core & ~missing])] = True
    higher, lower = _beside(values, numbers, missing, len(sizes))
    one_sided = np.maximum(higher, lower) >= ONE_SIDED * np.maximum(higher + lower, 1)
    kept = np.zeros(missing.shape, bool)
    places = find_objects(numbers + 1) if (wide & one_sided).any() else []
    for number in np.flatnonzero(wide & one_sided & (sizes >= SIZE)):
        rows, columns = places[number]
        around = tuple(slice(max(part.start - BESIDE, 0), part.stop + BESIDE) for part in (rows, columns))
        piece = (numbers[around] == number) & ~missing[around]
        kept[around] |= _levelled(values[around], missing[around], piece, quantum)
    return kept


def _level_regions(values: Array, missing: Array) -> Array:
    """The number (h, w), from 0, of the region of equal values of each sample."""
    index = np.arange(missing.size).reshape(missing.shape)
    pairs = []
    for one, two in _NEIGHBOURS:
        alike = (values[one] == values[two]) & ~missing[one] & ~missing[two]
        pairs.append(np.stack([index[one][alike], index[two][alike]]))
    ends = np.concatenate(pairs, axis=1)
    graph = coo_array((np.ones(ends.shape[1], bool), (ends[0], ends[1])), shape=(missing.size, missing.size))
    return np.asarray(connected_components(graph, directed=False)[1]).reshape(missing.shape)


def _within(numbers: Array) -> Array:
    """Mask (h, w) of the samples whose four neighbours belong to the same region."""
    inside = np.ones(numbers.shape, bool)
    for one, two in _NEIGHBOURS:
        same = numbers[one] == numbers[two]
        inside[one] &= same
        inside[two] &= same
    return inside


def _beside(values: Array, numbers: Array, missing: Array, count: int) -> tuple[Array, Array]:
    """The numbers of higher and of lower neighbours of each region."""
    higher, lower = np.zeros(count), np.zeros(count)
    for one, two in _NEIGHBOURS:
        known = ~missing[one] & ~missing[two]
        up, down = (values[two] > values[one]) & known, (values[two] < values[one]) & known
        higher += np.bincount(numbers[one][up], minlength=count) + np.bincount(numbers[two][down], minlength=count)
        lower += np.bincount(numbers[one][down], minlength=count) + np.bincount(numbers[two][up], minlength=count)
    return higher, lower


def _levelled(values: Array, missing: Array, piece: Array, quantum: float) -> Array:
    """The level part (h, w) of a region, without its shore; nothing unless it is much wider than the next step.

    The shore rises by up to half a quantum and was rounded to the same level. It is half as wide as the next step.
    """
    level = float(values[piece].flat[0])
    inland = _distance(np.pad(piece | missing, 1, mode="edge"))[1:-1, 1:-1]
    further = ~missing & (np.abs(values.astype(np.float64) - level) > 1.5 * quantum)
    near = further & np.asarray(binary_dilation(~further & ~missing, np.ones((3, 3), bool)), bool)
    width = float(np.median(_distance(~piece)[near])) - 1.0 if near.any() else 0.0
    if float(inland.max()) <= MUCH_WIDER * width:
        return np.zeros(piece.shape, bool)
    return np.logical_and(piece, inland > SHORE * width)


def _distance(inside: Array) -> Array:
    """The distance of each sample (h, w) to the nearest one that is not inside, in samples."""
    found: Array = np.asarray(distance_transform_edt(inside), np.float64)
    return found
