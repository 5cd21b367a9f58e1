"""Quality of results: differences, comparison with a known truth, and the comparison of flows.

**Differences of two surfaces**: :func:`compare` (data before and after), :func:`rms_difference`, :func:`median_difference`,
:func:`largest_difference`, :func:`normal_angle`, :func:`distance_rms`, :func:`structural_similarity`.

**Quality against a known truth**: :func:`grid_quality` (height fields, images), :func:`range_quality` (range images),
:func:`mesh_quality` (meshes), and where they are measured: :func:`edges_of`, :func:`jumps_of`, :func:`flipped`.

**Facts about data**: :func:`describe`.

**Four flows on one range image**: :func:`compare_flows`.
"""

from typing import TYPE_CHECKING

from meshflow.lazy import lazily

if TYPE_CHECKING:
    from meshflow.evaluate.facts import describe
    from meshflow.evaluate.flows import FlowComparison, compare_flows
    from meshflow.evaluate.grids import GridQuality, edges_of, grid_quality
    from meshflow.evaluate.meshes import MeshQuality, flipped, mesh_quality
    from meshflow.evaluate.metrics import (
        Comparison,
        compare,
        distance_rms,
        largest_difference,
        median_difference,
        normal_angle,
        rms_difference,
    )
    from meshflow.evaluate.range_images import RangeQuality, jumps_of, range_quality
    from meshflow.evaluate.similarity import structural_similarity

__all__ = [
    "Comparison",
    "FlowComparison",
    "GridQuality",
    "MeshQuality",
    "RangeQuality",
    "compare",
    "compare_flows",
    "describe",
    "distance_rms",
    "edges_of",
    "flipped",
    "grid_quality",
    "jumps_of",
    "largest_difference",
    "median_difference",
    "mesh_quality",
    "normal_angle",
    "range_quality",
    "rms_difference",
    "structural_similarity",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "metrics": (
            "Comparison",
            "compare",
            "distance_rms",
            "largest_difference",
            "median_difference",
            "normal_angle",
            "rms_difference",
        ),
        "similarity": ("structural_similarity",),
        "grids": ("GridQuality", "edges_of", "grid_quality"),
        "range_images": ("RangeQuality", "jumps_of", "range_quality"),
        "meshes": ("MeshQuality", "flipped", "mesh_quality"),
        "facts": ("describe",),
        "flows": ("FlowComparison", "compare_flows"),
    },
)
