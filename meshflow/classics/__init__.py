"""Classic methods as they were published, for comparison and by name: meshes with uniform weights, and schemes on grids.

===========================  =====================================================
:func:`umbrella`             Laplacian smoothing (Field 1988); it shrinks
:func:`taubin`               alternating steps of lambda and mu [Taubin 95]
:func:`hc`                   Humphrey's classes [Vollmer 99]
:func:`scale_dependent`      the scale-dependent umbrella, implicit [DMSB99]
:func:`perona_malik`         the four-neighbour scheme of [PM90], on grids
:func:`beltrami`             the Beltrami flow by finite differences [KMS97], on grids
:func:`hierarchy`            low curvature image simplifiers of several levels [TT99]
:func:`compressed`           the contrast of an image, compressed by them [TT99]
:func:`field_diffusion`      stripes along a vector field, on a surface [PR99]
:func:`field_picture`        the same on a grid
===========================  =====================================================

Those of meshes treat a mesh as a graph in which all edges count equally, or by their lengths. Therefore vertices drift along
the surface, and smooth shapes with uneven triangles change; the flows of meshflow do not have these effects. The methods are
included because others are compared with them.

The neighbours of a border vertex are: ``curve`` (default), its neighbours along the border, so that the border is smoothed as a
curve (the hierarchical neighbourhoods of [Taubin 95]); ``free``, all neighbours; ``fixed``, none, so that it stays. The order of
the triangles and of their corners makes no difference.
"""

from typing import TYPE_CHECKING

from meshflow.lazy import lazily

if TYPE_CHECKING:
    from meshflow.classics.grids import beltrami, perona_malik
    from meshflow.classics.humphrey import hc
    from meshflow.classics.implicit import scale_dependent
    from meshflow.classics.lambda_mu import mu, taubin
    from meshflow.classics.laplacian import umbrella
    from meshflow.classics.low_curvature import compressed, hierarchy
    from meshflow.classics.stripes import field_diffusion, field_picture

__all__ = [
    "beltrami",
    "compressed",
    "field_diffusion",
    "field_picture",
    "hc",
    "hierarchy",
    "mu",
    "perona_malik",
    "scale_dependent",
    "taubin",
    "umbrella",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "laplacian": ("umbrella",),
        "lambda_mu": ("mu", "taubin"),
        "humphrey": ("hc",),
        "implicit": ("scale_dependent",),
        "grids": ("beltrami", "perona_malik"),
        "low_curvature": ("compressed", "hierarchy"),
        "stripes": ("field_diffusion", "field_picture"),
    },
)
