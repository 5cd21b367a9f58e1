"""What a bug report needs: versions, threads, and the instruction set in use."""

import platform
from importlib.metadata import PackageNotFoundError, version

from meshflow.kernels.library import environment as compiled
from meshflow.results.result import release

__all__ = ["environment"]

PACKAGES = (
    "numpy", "scipy", "libigl", "pyamg", "trimesh", "pyvista", "vtk", "rasterio", "matplotlib", "typer", "open3d", "xarray",
    "rioxarray", "dask", "meshio", "OpenEXR", "nibabel", "pydicom",
)  # fmt: skip


def environment() -> dict[str, str]:
    """Names and values in reading order; packages that are not installed are listed as such."""
    kernels = compiled()
    found = {
        "meshflow": release(),
        "python": f"{platform.python_version()} ({platform.python_implementation()})",
        "system": platform.platform(),
        "processor": platform.machine(),
        "instruction set": kernels.instruction_set,
        "kernels compiled by": kernels.compiler,
        "threads": str(kernels.threads),
    }
    return {**found, **{package: _version(package) for package in PACKAGES}}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"
