"""Figure 1 of the paper: a map of Mars, quantised to 200 m, whose terraces go and whose volcanoes stay.

By default the flow runs for the time of least error, the same everywhere, and wide terraces leave ripples. In (c) it runs up to
five times as long where the ground rises by less than half a step per sample (``Mobility``): no ripples, and a larger error.

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
    folder, names = MARS, ("mola_olympus_crop_q200m_derived.tif", "mola_olympus_crop_derived.tif")
    if not (folder / names[0]).exists():
        folder, names = HOME / "data", ("terrain.tif", "terrain_truth.tif")
    raw, truth = (meshflow.read(folder / name).data for name in names)

    found, step = meshflow.smooth(raw, result=True), float(np.mean(raw.spacing[0]))
    smoothed, paper = found.data, meshflow.smooth(raw, method="beltrami")
    heat = meshflow.smooth(raw, method="heat", scale=3 * step)
    half = max(found.noise.quantum, found.noise.sigma) / 2
    gentle = np.clip((half / np.maximum(np.hypot(*np.gradient(heat.z)), 1e-9)) ** 2, 0.2, 1)
    held = [meshflow.Mobility(gentle), meshflow.MaxChange(2 * half)]
    flow = meshflow.Patches(patch=1.0, contrast=step / found.noise.sigma)
    longer = meshflow.smooth(raw, method=flow, time=5 * step**2, constraints=held)

    seen, fields = ~(raw.missing | truth.missing), (raw, smoothed, longer, paper, heat)
    errors = [float(np.sqrt(np.mean((field.z - truth.z)[seen] ** 2))) for field in fields]
    print(
        f"{names[0]}: rms error {errors[0]:.2f} m before, {errors[1]:.2f} m after, {errors[3]:.2f} m by the paper's flow, "
        f"{errors[2]:.2f} m where it runs longer on wide terraces"
    )
    if picture is not None:
        look = looking(altitude=25, renderer="hillshade")
        words = ("(a) raw", "(b) by default", "(c) longer on wide terraces", "(d) the paper's flow", "(e) a Gaussian")
        shades = [of_one(field, look).picture(0, (900, 600)) for field in (*fields, truth)]
        labels = [f"{word}, rms error {error:.1f} m" for word, error in zip(words, errors, strict=True)] + ["the truth"]
        tall = shades[0].shape[0] / shades[0].shape[1]
        page(list(zip(labels, shades, strict=True)), picture, "Figure 1: flat-shaded terrain", columns=2, tall=tall)
    return errors[1] / errors[0]


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
