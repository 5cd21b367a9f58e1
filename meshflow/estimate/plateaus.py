"""Level regions: lakes and levelled tops of quantised heights, as opposed to the steps of slopes; exact ones beside noise."""

import numpy as np
from scipy.ndimage import binary_dilation, binary_erosion, distance_transform_edt, find_objects
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from meshflow.geometry.validation import Array

__all__ = ["LEVEL_REACH", "equal_by_chance", "level_among_noise", "level_squares", "plateaus_of"]

# A plateau is kept if it has this width (samples from its middle to its shore) and this size, if this share of its neighbours
# is on one side of it (above or below), and if it is so many times wider than the next step within BESIDE samples.
WIDTH, SIZE, ONE_SIDED, MUCH_WIDER, BESIDE = 4, 100, 0.9, 2.0, 40
# The shore of a plateau, as a share of the width of the next step.
SHORE = 0.4
# Values that are not quantised are level by intention where all samples of a square of this side are equal; unless this share of
# the other neighbours is equal, too, as those of coarse steps are. So are equal samples up to so many steps from the squares.
SQUARE, BY_CHANCE, STEPS = 4, 0.1, 12
# So far from a sample lies what decides whether it is level.
LEVEL_REACH = SQUARE - 1 + STEPS


def level_among_noise(values: Array, missing: Array) -> Array | None:
    """:func:`level_squares` of values with noise; None where there are none, and where equal values may be chance.

    :param values: (h, w) or (h, w, k); ``missing``: (h, w).
    """
    level = level_squares(values, missing)
    return level if level.any() and not equal_by_chance(values, missing | level) else None


def equal_by_chance(values: Array, missing: Array) -> bool:
    """Whether many neighbours are equal, as those of coarse steps and of drawings are.

    :param values: (h, w) or (h, w, k).
    :param missing: (h, w), with the level regions.
    """
    pairs, equal = 0, 0
    for one, two in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        both = ~(missing[one] | missing[two])
        pairs += int(both.sum())
        equal += int((both & _alike(values[one], values[two])).sum())
    return equal >= BY_CHANCE * max(pairs, 1)


def level_squares(values: Array, missing: Array) -> Array:
    """Mask (h, w) of the samples of squares of equal values, and of equal ones around them: lakes, the sea, empty background.

    Noise leaves no such square. What is level can be told from a sample's surroundings alone, so that windows of a grid find the
    same as the whole.

    :param values: (h, w) or (h, w, k), all channels must be equal; ``missing``: (h, w).
    """
    h, w = missing.shape
    level = np.zeros((h, w), bool)
    if min(h, w) < SQUARE:
        return level
    along = _alike(values[:, :-1], values[:, 1:]) & ~(missing[:, :-1] | missing[:, 1:])
    down = _alike(values[:-1], values[1:]) & ~(missing[:-1] | missing[1:])
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
    for one, two in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        alike = (values[one] == values[two]) & ~missing[one] & ~missing[two]
        pairs.append(np.stack([index[one][alike], index[two][alike]]))
    ends = np.concatenate(pairs, axis=1)
    graph = coo_array((np.ones(ends.shape[1], bool), (ends[0], ends[1])), shape=(missing.size, missing.size))
    return np.asarray(connected_components(graph, directed=False)[1]).reshape(missing.shape)


def _within(numbers: Array) -> Array:
    """Mask (h, w) of the samples whose four neighbours belong to the same region."""
    inside = np.ones(numbers.shape, bool)
    for one, two in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        same = numbers[one] == numbers[two]
        inside[one] &= same
        inside[two] &= same
    return inside


def _beside(values: Array, numbers: Array, missing: Array, count: int) -> tuple[Array, Array]:
    """The numbers of higher and of lower neighbours of each region."""
    higher, lower = np.zeros(count), np.zeros(count)
    for one, two in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
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
