"""The tools that a user would take to smooth a grid, each by its own defaults or a plain choice."""

from collections.abc import Callable
from contextlib import suppress

import numpy as np

from meshflow.geometry.validation import Array

__all__ = ["by_their_defaults"]

Calls = dict[str, Callable[[], Array]]


def by_their_defaults(z: Array, threads: int) -> Calls:
    """Calls by name on values (h, w), float32, with noise of 2; tools that do not import here are left out, and named."""
    found: Calls = {}
    for package, of in (
        ("cv2", _opencv),
        ("SimpleITK", _itk),
        ("diplib", _diplib),
        ("medpy", _medpy),
        ("skimage", _skimage),
    ):
        try:
            found |= of(z, threads)
        except (ImportError, OSError) as cause:
            print(f"  {package} is left out: {cause}")
    return found


def _opencv(z: Array, threads: int) -> Calls:
    import cv2

    cv2.setNumThreads(threads)
    eight = np.clip(np.round(z - z.min()), 0, 255).astype(np.uint8)
    colour = np.ascontiguousarray(np.repeat(eight[..., None], 3, axis=2))
    return {
        "OpenCV bilateralFilter d = 7": lambda: cv2.bilateralFilter(z, 7, 6, 3),
        "OpenCV fastGlobalSmoother": lambda: cv2.ximgproc.fastGlobalSmootherFilter(eight, z, 100, 6),
        "OpenCV anisotropicDiffusion, 20, 8 bit x 3": lambda: cv2.ximgproc.anisotropicDiffusion(colour, 0.15, 0.1, 20),
    }


def _itk(z: Array, threads: int) -> Calls:
    import SimpleITK as sitk

    sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(threads)
    image = sitk.GetImageFromArray(z)
    return {
        "SimpleITK gradient diffusion, 20": lambda: sitk.GradientAnisotropicDiffusion(image, 0.125, 1.0, 1, 20),
        "SimpleITK curvature diffusion, 20": lambda: sitk.CurvatureAnisotropicDiffusion(image, 0.0625, 3.0, 1, 20),
        "SimpleITK curvature flow, 20": lambda: sitk.CurvatureFlow(image, 0.0625, 20),
    }


def _diplib(z: Array, threads: int) -> Calls:
    with suppress(ImportError):
        import IPython.terminal.pt_inputhooks  # noqa: F401 - diplib's viewer takes it for granted where IPython is
    import diplib

    diplib.SetNumberOfThreads(threads)
    return {"diplib Perona-Malik, 20": lambda: diplib.PeronaMalikDiffusion(z, 20, 4.0, 0.25)}


def _medpy(z: Array, threads: int) -> Calls:
    from medpy.filter.smoothing import anisotropic_diffusion

    return {"medpy Perona-Malik, 20": lambda: anisotropic_diffusion(z, 20, 4, 0.1)}


def _skimage(z: Array, threads: int) -> Calls:
    from skimage.restoration import denoise_bilateral, denoise_nl_means, denoise_tv_chambolle

    calls = {
        "skimage TV, its defaults": lambda: denoise_tv_chambolle(z),
        "skimage NLM, its defaults, sigma given": lambda: denoise_nl_means(z, sigma=2.0, h=1.6, fast_mode=True),
    }
    if z.size <= 512**2:  # on a larger grid it takes minutes
        calls["skimage bilateral, its defaults"] = lambda: denoise_bilateral(z, sigma_color=6, sigma_spatial=3)
    return calls
