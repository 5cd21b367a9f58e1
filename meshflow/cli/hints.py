"""Words of other tools for what our commands call otherwise."""

import re

__all__ = ["hint_for", "method_hint"]

_FLAGS = {
    "iterations": "how far it goes is --time (or --scale, a length); --steps is a number of steps",
    "iter": "how far it goes is --time (or --scale, a length); --steps is a number of steps",
    "n-iter": "how far it goes is --time (or --scale, a length); --steps is a number of steps",
    "niter": "how far it goes is --time (or --scale, a length); --steps is a number of steps",
    "lambda": "a step of the flow is --time; --method fairing --order N keeps the volume as lambda and mu of Taubin do",
    "lamb": "a step of the flow is --time; --method fairing --order N keeps the volume as lambda and mu of Taubin do",
    "mu": "lambda and mu of Taubin are --method fairing --order N here",
    "pass-band": "--method fairing --order N is a low pass of the mesh here",
    "sigma": "the noise is --noise; the width of a Gaussian is --scale",
    "sigma-color": "the noise is --noise; the width of a Gaussian is --scale",
    "sigma-space": "the width of a Gaussian is --scale",
    "kappa": "the slope that counts as an edge is set by --contrast (its inverse)",
    "radius": "the width of a Gaussian is --scale",
    "output": "OUT stands behind IN: smooth IN OUT",
    "force": "a file is replaced with --overwrite",
    "bands": "one band is chosen with --band",
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
    """What is meant by an option of other tools that a refusal names; empty where it names none."""
    found = re.search(r"[Nn]o such option:? '?--?([\w-]+)", message)
    word = _FLAGS.get(found.group(1).lower().replace("_", "-"), "") if found else ""
    return f"; {word}" if word else ""


def method_hint(word: str) -> str:
    """Which method a word of other tools stands for; empty where it is none."""
    return _METHODS.get(word.lower().replace("_", "-").replace(" ", "-"), "")
