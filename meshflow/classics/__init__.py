"""The classics of mesh smoothing with uniform weights, plain and correct, for comparison and for those who ask by name.

===========================  =====================================================
:func:`umbrella`             Laplacian smoothing (Field 1988); it shrinks
:func:`taubin`               a step of lambda and one of mu in turn [Taubin 95]
:func:`hc`                   Humphrey's classes [Vollmer 99]
:func:`scale_dependent`      the scale-dependent umbrella, implicit [DMSB99]
===========================  =====================================================

They treat a mesh as a graph. Every edge counts alike, or by its length, so vertices drift along the surface, and shapes of
uneven triangles change although they are smooth. The flows of meshflow do not; these are here since others are measured by them.

The neighbours of a border vertex are, by name: ``curve`` (default), its neighbours along the border alone, so that a border is
smoothed as the curve that it is (the hierarchical neighbourhoods of [Taubin 95]); ``free``, all of them; ``fixed``, none: it
stays. The order of the triangles and of their corners makes no difference.
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
