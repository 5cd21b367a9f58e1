"""Peers of volumes, by name: with the parameter that is best for the truth, or told the noise; absent where not installed."""

from importlib import import_module
from importlib.util import find_spec

import numpy as np
from skimage.restoration import denoise_nl_means, denoise_tv_chambolle

__all__ = ["PEERS", "decibels", "local_pca", "non_local_means_of_dipy"]


def decibels(found, truth):
    return float(-10 * np.log10(np.mean(np.square(found - truth))))


def best(found, truth):
    return max(found, key=lambda one: decibels(one, truth))


def non_local_means(x, sigma, truth, rician):
    return best([denoise_nl_means(x, 3, 4, h * sigma, sigma=sigma) for h in (0.4, 0.6, 0.8, 1.0)], truth)


def total_variation(x, sigma, truth, rician):
    return best([denoise_tv_chambolle(x, w * sigma) for w in (0.6, 0.8, 1.0, 1.3, 1.7, 2.2)], truth)


def diffusion(name):
    """A diffusion of ITK: the best of its conductances and numbers of iterations."""

    def run(x, sigma, truth, rician):
        itk = import_module("SimpleITK")
        image = itk.GetImageFromArray(x.astype(np.float32))
        found = []
        for conductance in (0.5, 1.0, 2.0, 4.0):
            for count in (5, 15, 40):
                done = getattr(itk, name)(image, 0.0625, conductance, 1, count)
                found.append(itk.GetArrayFromImage(done))
        return best(found, truth)

    return run


def non_local_means_of_dipy(x, sigma, truth, rician):
    """The best of both methods; told the noise itself, it leaves much of it."""
    nlmeans = import_module("dipy.denoise.nlmeans").nlmeans
    ways = [
        ("blockwise", 0.7),
        ("blockwise", 1.0),
        ("blockwise", 1.5),
        ("classic", 1.0),
        ("classic", 2.0),
        ("classic", 3.0),
    ]
    found = [
        nlmeans(x.astype(np.float64), sigma=by * sigma, rician=rician, num_threads=2, method=way) for way, by in ways
    ]
    return best(found, truth)


def local_pca(x, sigma):
    """LPCA of dipy (Manjón et al. 2013), on the signals of all gradients."""
    return import_module("dipy.denoise.localpca").localpca(x.astype(np.float64), sigma=sigma)


def bm4d(x, sigma, truth, rician):
    """BM4D (Maggioni et al. 2013), told the noise; its licence allows no commercial use, and it is no part of the package."""
    return import_module("bm4d").bm4d(x.astype(np.float64), sigma)


EVERY = {
    "non-local means": ("skimage", non_local_means),
    "total variation": ("skimage", total_variation),
    "ITK gradient diffusion": ("SimpleITK", diffusion("GradientAnisotropicDiffusion")),
    "ITK curvature diffusion": ("SimpleITK", diffusion("CurvatureAnisotropicDiffusion")),
    "dipy NLMEANS": ("dipy", non_local_means_of_dipy),
    "BM4D": ("bm4d", bm4d),
}
# Those that are installed.
PEERS = {name: run for name, (package, run) in EVERY.items() if find_spec(package)}
