"""The peers: what others use to denoise a grid, each a plain function with the parameters over which it is searched.

Every ``run(z, sigma, **parameters)`` takes values (h, w) or (h, w, k) and the standard deviation of their noise, and returns
values of the same shape. A parameter that is called a multiple is one of sigma. The packages are imported where they are used.
"""

from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from meshflow.errors import need
from meshflow.geometry.validation import Array
from peers.search import Peer

__all__ = ["PEERS"]


def _each(filtered: Callable[[Array], Array], z: Array) -> Array:
    """A filter of one channel (h, w), float32, over each channel."""
    planes = z.astype(np.float32)
    if z.ndim == 2:
        return filtered(planes)
    return np.stack([filtered(np.ascontiguousarray(planes[..., c])) for c in range(z.shape[2])], axis=-1)


def _axis(z: Array) -> int | None:
    return 2 if z.ndim == 3 else None


def _stretched(z: Array, dtype: type[np.unsignedinteger]) -> tuple[Array, float, float]:
    """Values over the whole range of an integer type: those, the factor, and the value at zero."""
    low, high = float(z.min()), float(z.max())
    factor = np.iinfo(dtype).max / max(high - low, float(np.finfo(np.float32).tiny))
    return np.rint((z - low) * factor).astype(dtype), factor, low


def total_variation(z: Array, sigma: float, weight: float) -> Array:
    """Rudin, Osher and Fatemi 1992, by Chambolle's iteration: skimage. ``weight`` is a multiple."""
    denoise = need("skimage.restoration", "bench").denoise_tv_chambolle
    return sigma * denoise(z / sigma, weight=weight, eps=1e-5, max_num_iter=500, channel_axis=_axis(z))


def bilateral(z: Array, sigma: float, colour: float, space: float) -> Array:
    """Tomasi and Manduchi 1998: OpenCV. ``colour`` is a multiple (summed over channels), ``space`` in samples."""
    return need("cv2", "bench").bilateralFilter(z.astype(np.float32), -1, colour * sigma, space)


def nlm_skimage(z: Array, sigma: float, h: float, patch: int, distance: int) -> Array:
    """Buades, Coll and Morel 2005, the noise told: skimage. ``h`` is a multiple, patch and distance in samples."""
    denoise = need("skimage.restoration", "bench").denoise_nl_means
    return denoise(z, patch, distance, h * sigma, fast_mode=True, sigma=sigma, channel_axis=_axis(z))


def nlm_opencv(z: Array, sigma: float, h: float, patch: int, window: int, depth: str) -> Array:
    """Buades, Coll and Morel 2005, on integers: OpenCV. ``h`` is a multiple, patch and window in samples.

    :param depth: ``8 bit`` (squared differences) or ``16 bit`` (their absolute values: OpenCV has no other).
    """
    cv2 = need("cv2", "bench")
    whole, factor, low = _stretched(z, np.uint8 if depth == "8 bit" else np.uint16)
    norm = cv2.NORM_L2 if depth == "8 bit" else cv2.NORM_L1
    sizes = {"templateWindowSize": patch, "searchWindowSize": window, "normType": norm}
    return cv2.fastNlMeansDenoising(whole, h=[h * sigma * factor], **sizes).astype(np.float64) / factor + low


def wavelet(z: Array, sigma: float, threshold: float, family: str, method: str, mode: str) -> Array:
    """Wavelet shrinkage, averaged over 4 x 4 shifts (Coifman and Donoho 1995): skimage. ``threshold`` is a multiple."""
    restoration = need("skimage.restoration", "bench")
    how = {"sigma": threshold * sigma, "wavelet": family, "method": method, "mode": mode, "rescale_sigma": True}
    how["channel_axis"] = _axis(z)
    return restoration.cycle_spin(
        z, restoration.denoise_wavelet, max_shifts=3, func_kw=how, workers=1, channel_axis=_axis(z)
    )


def gaussian(z: Array, sigma: float, width: float) -> Array:
    """Gaussian filter: scipy. ``width`` in samples."""
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(z, width, axes=(0, 1)))


def gradient_diffusion(z: Array, sigma: float, conductance: float, iterations: int) -> Array:
    """Perona and Malik 1990, conductance relative to the mean gradient: SimpleITK, its largest stable step."""
    sitk = need("SimpleITK", "bench")

    def one(plane: Array) -> Array:
        image = sitk.GetImageFromArray(plane)
        return sitk.GetArrayFromImage(sitk.GradientAnisotropicDiffusion(image, 0.125, conductance, 1, int(iterations)))

    return _each(one, z)


def curvature_diffusion(z: Array, sigma: float, conductance: float, iterations: int) -> Array:
    """Whitaker and Xue's modified curvature diffusion: SimpleITK, its largest stable step."""
    sitk = need("SimpleITK", "bench")

    def one(plane: Array) -> Array:
        image = sitk.GetImageFromArray(plane)
        return sitk.GetArrayFromImage(
            sitk.CurvatureAnisotropicDiffusion(image, 0.0625, conductance, 1, int(iterations))
        )

    return _each(one, z)


def perona_malik(z: Array, sigma: float, kappa: float, iterations: int, weight: str) -> Array:
    """Perona and Malik 1990, with their exponential weight or Tukey's (Black et al. 1998): MedPy. ``kappa`` is a multiple."""
    diffused = need("medpy.filter.smoothing", "bench").anisotropic_diffusion
    option = {"exponential": 1, "tukey": 3}[weight]
    return _each(lambda plane: diffused(plane, int(iterations), kappa * sigma, 0.2, None, option), z)


def global_smoother(z: Array, sigma: float, smoothness: float, colour: float) -> Array:
    """Min et al. 2014, guided by the data in 8 bit: OpenCV. ``colour`` is a multiple, ``smoothness`` its lambda."""
    smooth = need("cv2", "bench").ximgproc.fastGlobalSmootherFilter
    guide, factor, _ = _stretched(z, np.uint8)
    return smooth(guide, z.astype(np.float32), smoothness, colour * sigma * factor)


def feature_preserving(
    z: Array, sigma: float, size: int, angle: float, iterations: int, limit: float, steepness: float
) -> Array:
    """Lindsay et al. 2019, smoothed normals: whitebox-workflows, which reads a file of one channel.

    :param size: of the filter, samples.
    :param angle: degrees up to which neighbouring normals count.
    :param limit: largest change of a height, a multiple.
    :param steepness: heights are divided by sigma and multiplied by this before normals are taken.
    """
    session = need("whitebox_workflows", "bench").WbEnvironment()
    session.verbose = False
    rasterio = need("rasterio", "bench")
    origin = rasterio.Affine(1.0, 0.0, 500000.0, 0.0, -1.0, 4000000.0)
    form: dict[str, Any] = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": "EPSG:32611", "nodata": -9999.0}
    with TemporaryDirectory() as folder:
        path = str(Path(folder) / "z.tif")
        with rasterio.open(path, "w", height=z.shape[0], width=z.shape[1], transform=origin, **form) as target:
            target.write(z.astype(np.float32), 1)
        raster = session.read_raster(path)
        options = (int(size), float(angle), int(iterations), limit * sigma, steepness / sigma)
        return np.array(session.feature_preserving_smoothing(raster, *options).to_numpy())


def bm3d(z: Array, sigma: float, strength: float) -> Array:
    """Dabov et al. 2007: the authors' own package, free for research only. ``strength`` is a multiple."""
    package = need("bm3d", "bench")
    return package.bm3d_rgb(z, strength * sigma) if z.ndim == 3 else package.bm3d(z, strength * sigma)


# Ranges are as wide as it takes for no best to lie on their edge in tests/bench_quality.py, which marks those that do.
_ITERATIONS = (2, 5, 10, 20, 40, 80, 160, 500)
PEERS: tuple[Peer, ...] = (
    Peer(
        "TV",
        "scikit-image",
        total_variation,
        {"weight": (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.85, 1.0, 1.2, 1.4, 1.7, 2.0, 2.4, 2.8, 4.0, 6.0)},
    ),
    Peer(
        "bilateral",
        "opencv-contrib-python-headless",
        bilateral,
        {
            "colour": (0.7, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 14.0, 20.0, 40.0),
            "space": (0.3, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 25.0),
        },
        frozenset({("colour", 40.0)}),  # a Gaussian filter
    ),
    Peer(
        "NLM",
        "scikit-image",
        nlm_skimage,
        {
            "h": (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.2, 1.5, 2.0, 3.0, 5.0, 10.0),
            "patch": (3, 5, 7, 9, 11),
            "distance": (1, 2, 3, 5, 8, 11, 15, 30),
        },
        frozenset({("patch", 3), ("distance", 1)}),
    ),
    Peer(
        "NLM OpenCV",
        "opencv-contrib-python-headless",
        nlm_opencv,
        {
            "h": (0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.7, 2.0, 2.5, 3.0, 4.0, 6.0, 10.0),
            "patch": (1, 3, 5, 7, 9),
            "window": (3, 5, 7, 11, 17, 25, 35, 71),
            "depth": ("8 bit", "16 bit"),
        },
        frozenset({("patch", 1), ("window", 3)}),
    ),
    Peer(
        "wavelet",
        "scikit-image",
        wavelet,
        {
            "threshold": (0.12, 0.25, 0.35, 0.5, 0.7, 1.0, 1.2, 1.5, 2.0),
            "family": ("haar", "db2", "sym4"),
            "method": ("BayesShrink", "VisuShrink"),
            "mode": ("soft", "hard"),
        },
    ),
    Peer(
        "Gaussian",
        "scipy",
        gaussian,
        {"width": (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0, 1.2, 1.4, 1.7, 2.0, 2.5, 3.0, 4.0)},
    ),
    Peer(
        "SimpleITK gradient diffusion",
        "SimpleITK",
        gradient_diffusion,
        {
            "conductance": (0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.5, 4.0, 7.0, 20.0),
            "iterations": _ITERATIONS,
        },
        frozenset({("conductance", 20.0)}),  # the heat equation
    ),
    Peer(
        "SimpleITK curvature diffusion",
        "SimpleITK",
        curvature_diffusion,
        {
            "conductance": (0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 7.5, 12.0, 20.0, 60.0),
            "iterations": _ITERATIONS,
        },
        frozenset({("conductance", 60.0)}),  # motion by curvature
    ),
    Peer(
        "MedPy Perona-Malik",
        "MedPy",
        perona_malik,
        {
            "kappa": (0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 12.0, 20.0, 60.0),
            "iterations": (1, 2, 5, 10, 20, 40, 80, 160, 400, 2000),
            "weight": ("exponential", "tukey"),
        },
        frozenset({("kappa", 60.0), ("iterations", 1)}),  # the heat equation
    ),
    Peer(
        "OpenCV fastGlobalSmoother",
        "opencv-contrib-python-headless",
        global_smoother,
        {
            "smoothness": (0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, 3000.0, 10000.0),
            "colour": (0.2, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 3.0, 5.0, 8.0, 20.0),
        },
    ),
    Peer(
        "whitebox FeaturePreservingSmoothing",
        "whitebox-workflows",
        feature_preserving,
        {
            "size": (3, 5, 11, 21, 41),
            "angle": (1.0, 2.0, 4.0, 8.0, 15.0, 30.0, 60.0, 90.0),
            "iterations": (1, 3, 10, 30, 100, 300),
            "limit": (0.2, 0.5, 1.0, 1.5, 2.0, 3.0, 6.0, 20.0),
            "steepness": (0.003, 0.01, 0.03, 0.1, 0.3, 1.0),
        },
        frozenset({("iterations", 1), ("size", 3), ("angle", 90.0)}),
        channels=False,
    ),
    Peer("BM3D", "bm3d", bm3d, {"strength": (0.5, 0.7, 1.0, 1.3, 1.8, 2.5)}),
)
