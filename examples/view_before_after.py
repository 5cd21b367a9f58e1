"""Smooth a terrain file, write it as GeoTIFF, and draw it before and after with the difference below.

``python examples/view_before_after.py [FOLDER]`` writes ``smoothed.tif`` and ``before_after.png`` there.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import meshflow
import meshflow.view

DATA = Path(__file__).resolve().parents[1] / "data"


def main(folder: Path | None = None) -> float:
    """The rms of what was removed, metres; the noise that went in was 2 m."""
    folder = folder or Path(tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    document = meshflow.read(DATA / "terrain.tif")
    before = document.data

    after = meshflow.smooth(before)

    meshflow.write(document.holding(after), folder / "smoothed.tif", overwrite=True)
    drawn = meshflow.view.compare(before, after, folder / "before_after.png", title="Noisy terrain", overwrite=True)
    removed = float(np.sqrt(np.mean((after.z - before.z)[~before.missing] ** 2)))
    print(f"{drawn.path}: rms of what was removed {removed:.2f} m")
    return removed


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
