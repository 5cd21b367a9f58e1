"""Figure 1 of the paper: a map of Mars, quantised to 200 m, whose terraces go and whose volcanoes stay.

``python examples/paper_1_terrain.py [PICTURE.png]``. MOLA data from ``../shared/data`` where that is present, with the true
heights beside it; else the noisy terrain that ships with the project.
"""

import sys
from pathlib import Path

import numpy as np

import meshflow
from meshflow.view.look import looking
from meshflow.view.scene import of_one

sys.path.insert(0, str(Path(__file__).parent))
from drawing import page

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

    smoothed, paper = meshflow.smooth(raw), meshflow.smooth(raw, method="beltrami")

    seen = ~(raw.missing | truth.missing)
    errors = [float(np.sqrt(np.mean((field.z - truth.z)[seen] ** 2))) for field in (raw, smoothed, paper)]
    print(
        f"{names[0]}: rms error {errors[0]:.2f} m before, {errors[1]:.2f} m after, {errors[2]:.2f} m by the paper's flow"
    )
    if picture is not None:
        look = looking(altitude=25, renderer="hillshade")
        words = ("(a) raw", "(b) by default", "(c) the paper's flow", "the truth")
        shades = [of_one(field, look).picture(0, (900, 600)) for field in (raw, smoothed, paper, truth)]
        labels = [f"{word}, rms error {error:.1f} m" for word, error in zip(words, errors, strict=False)] + [words[3]]
        panels = list(zip(labels, shades, strict=True))
        page(panels, picture, "Figure 1: flat-shaded terrain", columns=2, tall=shades[0].shape[0] / shades[0].shape[1])
    return errors[1] / errors[0]


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
