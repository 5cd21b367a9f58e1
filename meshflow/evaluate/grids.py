"""Quality of a smoothed grid against the truth."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.evaluate.metrics import compare, rms_difference
from meshflow.evaluate.similarity import structural_similarity
from meshflow.geometry.validation import Array, positive
from meshflow.surfaces.height_field import HeightField

__all__ = ["EDGE_REACH", "EDGE_SHARE", "GridQuality", "edges_of", "grid_quality"]

# Edges are where the gradient of the truth is in its top 5 %; near them is within 2 samples, diagonals included.
EDGE_SHARE, EDGE_REACH = 0.05, 2


@dataclass(frozen=True)
class GridQuality:
    """Differences of a result from the truth.

    :ivar rms: root mean square difference, all channels together, in the unit of the values.
    :ivar rms_near_edges: the same for samples near edges of the truth only, see :func:`edges_of`; NaN without edges.
    :ivar normal_error: mean angle, degrees, between the normals of the same triangles of both height fields; None for images.
    :ivar ssim: mean structural similarity of images, 1 at best, window 7 x 7, channels averaged; None for height fields.
    :ivar psnr: peak over rms, decibels; infinite where nothing differs.
    """

    rms: float
    rms_near_edges: float
    normal_error: float | None
    ssim: float | None
    psnr: float


def grid_quality(
    found: ArrayLike,
    truth: ArrayLike,
    kind: Literal["terrain", "image"] = "terrain",
    spacing: float | tuple[float, float] = 1.0,
    peak: float | None = None,
) -> GridQuality:
    """Compare a result with the truth, over the samples that are finite in both.

    Example:

        >>> from meshflow.synthetic import mesas, noisy
        >>> round(grid_quality(noisy(mesas(64), 2.0), mesas(64)).rms)
        2

    :param found: (h, w), or for images (h, w, k).
    :param truth: the same shape.
    :param kind: ``terrain`` measures normals, ``image`` structural similarity, which needs all samples.
    :param spacing: of the samples of a terrain, one number or (dx, dy), in the unit of the heights.
    :param peak: the whole range of the values, for PSNR and SSIM; by default the range of the truth.
    :raises InputError: for an unknown kind, different shapes, a peak that is not positive, or no sample finite in both.
    """
    if kind not in ("terrain", "image"):
        raise InputError(f"grid_quality: kind terrain or image expected, got {kind!r}")
    one, other = np.asarray(found, dtype=np.float64), np.asarray(truth, dtype=np.float64)
    rms = rms_difference(one, other)
    reach = positive(np.nanmax(other) - np.nanmin(other) if peak is None else peak, "grid_quality: peak")
    edges = edges_of(other)
    normals = ssim = None
    if kind == "terrain":
        steps = (spacing, spacing) if isinstance(spacing, (int, float)) else spacing
        normals = compare(HeightField(other, steps), HeightField(one, steps)).normal_angle
    else:
        ssim = structural_similarity(one, other, reach)
    return GridQuality(
        rms=rms,
        rms_near_edges=rms_difference(one[edges], other[edges]) if edges.any() else np.nan,
        normal_error=normals,
        ssim=ssim,
        psnr=float(20.0 * np.log10(reach / rms)) if rms > 0 else np.inf,
    )


def edges_of(truth: ArrayLike, share: float = EDGE_SHARE, reach: int = EDGE_REACH) -> Array:
    """The samples (h, w) near an edge: within ``reach`` of where the gradient of the truth is in its top ``share``.

    The gradient is by central differences; its magnitude is over both axes and all channels. Where less than that share has a
    nonzero gradient, the edges are those samples; a constant truth has none.

    Example:

        >>> import numpy as np
        >>> int(edges_of(np.repeat([[0.0] * 8 + [1.0] * 8], 8, axis=0), reach=1)[0].sum())
        4

    :param truth: (h, w) or (h, w, k); NaN is missing and gives no edge.
    :param share: between 0 and 1.
    :param reach: samples, along rows, columns and diagonals.
    """
    from scipy.ndimage import binary_dilation

    values = np.asarray(truth, dtype=np.float64)
    planes = values if values.ndim == 3 else values[..., None]
    size = np.sqrt(sum(np.square(np.asarray(slope)).sum(axis=2) for slope in np.gradient(planes, axis=(0, 1))))
    there = np.isfinite(size)
    if not there.any():
        return np.zeros(size.shape, bool)
    steep = there & (size > 0) & (size >= np.quantile(size[there], 1.0 - share))
    return binary_dilation(steep, np.ones((3, 3), bool), iterations=reach) if reach > 0 else steep
