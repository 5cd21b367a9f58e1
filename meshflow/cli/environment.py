"""What matters for a report of a fault: versions, threads, and the instruction set in use."""

import platform
from importlib.metadata import PackageNotFoundError, version

from meshflow.kernels.library import environment as compiled
from meshflow.results.result import release

__all__ = ["environment"]

PACKAGES = (
    "numpy", "scipy", "libigl", "pyamg", "trimesh", "pyvista", "vtk", "rasterio", "matplotlib", "typer", "open3d", "xarray",
    "rioxarray", "dask", "meshio", "OpenEXR",
)  # fmt: skip


def environment() -> dict[str, str]:
    """Names to values, in reading order; a package that is not installed is told so."""
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
