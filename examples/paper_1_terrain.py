"""Figure 1 of the paper: a map of Mars, quantised to 200 m, whose terraces go and whose volcanoes stay.

``python examples/paper_1_terrain.py [PICTURE.png]``. MOLA data from ``../shared/data`` where that is present, with the true
heights beside it; else the noisy terrain that ships with the project.
"""

import sys
from pathlib import Path

import numpy as np

import meshflow
import meshflow.view

HOME = Path(__file__).resolve().parents[1]
MARS = HOME.parent / "shared" / "data" / "dem"


def main(picture: Path | None = None) -> float:
    """The rms error after over that before."""
    there = (MARS / "mola_olympus_crop_q200m_derived.tif").exists()
    folder, names = (
        (MARS, ("mola_olympus_crop_q200m_derived.tif", "mola_olympus_crop_derived.tif"))
        if there
        else (HOME / "data", ("terrain.tif", "terrain_truth.tif"))
    )
    raw, truth = (meshflow.read(folder / name).data for name in names)

    smoothed = meshflow.smooth(raw)

    seen = ~(raw.missing | truth.missing)
    before, after = (float(np.sqrt(np.mean((field.z - truth.z)[seen] ** 2))) for field in (raw, smoothed))
    print(f"{names[0]}: rms error {before:.2f} m before, {after:.2f} m after")
    if picture is not None:
        meshflow.view.compare(
            raw,
            smoothed,
            picture,
            size=(1400, 1000),
            altitude=20,
            title="Figure 1: flat-shaded terrain",
            overwrite=True,
        )
    return after / before


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
