"""Classic methods of mesh smoothing with uniform weights, for comparison and by name.

===========================  =====================================================
:func:`umbrella`             Laplacian smoothing (Field 1988); it shrinks
:func:`taubin`               alternating steps of lambda and mu [Taubin 95]
:func:`hc`                   Humphrey's classes [Vollmer 99]
:func:`scale_dependent`      the scale-dependent umbrella, implicit [DMSB99]
===========================  =====================================================

They treat a mesh as a graph in which all edges count equally, or by their lengths. Therefore vertices drift along the surface,
and smooth shapes with uneven triangles change; the flows of meshflow do not have these effects. The methods are included
because others are compared with them.

The neighbours of a border vertex are: ``curve`` (default), its neighbours along the border, so that the border is smoothed as a
curve (the hierarchical neighbourhoods of [Taubin 95]); ``free``, all neighbours; ``fixed``, none, so that it stays. The order of
the triangles and of their corners makes no difference.
"""

from typing import TYPE_CHECKING

from meshflow.lazy import lazily

if TYPE_CHECKING:
    from meshflow.classics.humphrey import hc
    from meshflow.classics.implicit import scale_dependent
    from meshflow.classics.lambda_mu import mu, taubin
    from meshflow.classics.laplacian import umbrella

__all__ = ["hc", "mu", "scale_dependent", "taubin", "umbrella"]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "laplacian": ("umbrella",),
        "lambda_mu": ("mu", "taubin"),
        "humphrey": ("hc",),
        "implicit": ("scale_dependent",),
    },
)
