"""Smooth a depth image along the rays of its camera, and measure it against the truth.

A depth camera errs along its lines of sight: each point may move along its own, and nowhere else. Planes rest, wherever they are
seen from, and triangles across a jump of depth are left out. Time is counted in pixels of the camera.

``python examples/smooth_range_scan.py [PICTURE.png]`` draws both from beside the camera, as Figure 9 of the paper does.
"""

import sys
from pathlib import Path

import numpy as np

import meshflow
import meshflow.view

DATA = Path(__file__).resolve().parents[1] / "data"


def main(picture: Path | None = None) -> float:
    """The rms error after over that before."""
    scan = meshflow.read(DATA / "scene_depth.png", camera=DATA / "scene_camera.json").data
    truth = meshflow.read(DATA / "scene_truth.tif", camera=DATA / "scene_camera.json").data

    smoothed = meshflow.smooth(scan, time=5.0)

    seen = ~(scan.missing | truth.missing)
    before, after = (1000 * np.sqrt(np.mean((data.depth - truth.depth)[seen] ** 2)) for data in (scan, smoothed))
    print(f"rms error of the depth: {before:.2f} mm before, {after:.2f} mm after")
    if picture is not None:
        meshflow.view.compare(
            scan, smoothed, picture, seen="side", size=(1400, 1000), title="Figure 9: a range image", overwrite=True
        )
    return after / before


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
