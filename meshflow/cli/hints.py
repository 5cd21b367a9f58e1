"""Hints for names of other tools that have different names in our commands."""

import re

__all__ = ["hint_for", "method_hint"]

_FLAGS = {
    "iterations": "the amount of smoothing is set by --time (or --scale, a length); --steps is a number of steps",
    "iter": "the amount of smoothing is set by --time (or --scale, a length); --steps is a number of steps",
    "n-iter": "the amount of smoothing is set by --time (or --scale, a length); --steps is a number of steps",
    "niter": "the amount of smoothing is set by --time (or --scale, a length); --steps is a number of steps",
    "lambda": "the flow has --time; --method fairing --order N keeps the volume, as lambda and mu of Taubin do",
    "lamb": "the flow has --time; --method fairing --order N keeps the volume, as lambda and mu of Taubin do",
    "mu": "for lambda and mu of Taubin use --method fairing --order N",
    "pass-band": "for a low-pass filter of a mesh use --method fairing --order N",
    "sigma": "the noise is set by --noise; the width of a Gaussian by --scale",
    "sigma-color": "the noise is set by --noise; the width of a Gaussian by --scale",
    "sigma-space": "the width of a Gaussian is set by --scale",
    "kappa": "the slope that counts as an edge is set by --contrast (its inverse)",
    "radius": "the width of a Gaussian is set by --scale",
    "output": "the output is the second argument: smooth IN OUT",
    "force": "use --overwrite to replace a file",
    "bands": "use --band to choose a band",
}
_METHODS = {
    "taubin": "fairing (--order N), which keeps the volume as it does",
    "laplacian": "curvature (meshes) or heat (grids)",
    "laplace": "curvature (meshes) or heat (grids)",
    "mean-curvature-flow": "curvature (meshes) or graph (grids)",
    "humphrey": "curvature with --preserve volume",
    "gaussian": "heat with --scale",
    "bilateral": "normal-filter (meshes) or patches (grids)",
    "nlm": "patches",
    "nl-means": "patches",
    "median": "total-variation",
    "tv": "total-variation",
    "rof": "total-variation",
    "pm": "perona-malik",
    "anisotropic": "perona-malik or beltrami",
    "anisotropic-diffusion": "perona-malik or beltrami",
    "windowed-sinc": "fairing (--order N)",
    "two-step": "normal-filter",
}


def hint_for(message: str) -> str:
    """A hint for an option of other tools in an error message; empty if it has none."""
    found = re.search(r"[Nn]o such option:? '?--?([\w-]+)", message)
    word = _FLAGS.get(found.group(1).lower().replace("_", "-"), "") if found else ""
    return f"; {word}" if word else ""


def method_hint(word: str) -> str:
    """The method that corresponds to a method name of other tools; empty if there is none."""
    return _METHODS.get(word.lower().replace("_", "-").replace(" ", "-"), "")
