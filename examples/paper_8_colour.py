"""Figure 8 of the paper: a noisy colour photograph after 300 explicit steps of the Beltrami flow, and by super-time-stepping.

``python examples/paper_8_colour.py [PICTURE.png]`` (needs scikit-image)
"""

import sys
from pathlib import Path

import numpy as np
import skimage.data

import meshflow
import meshflow.view
from meshflow.flow.super_time import stages
from meshflow.surfaces.image import Image


def main(picture: Path | None = None) -> tuple[int, float]:
    """Rates that super-time-stepping needs for 300 explicit steps, and how far its result is from theirs, rms, in grey levels."""
    truth = skimage.data.astronaut()[30:190, 140:330].astype(float)
    noisy = Image(truth + 20.0 * np.random.default_rng(0).normal(size=truth.shape))
    lift, dt = meshflow.Lift(contrast=0.1, boundary="neumann"), 1.0 / 24.0
    flow = meshflow.GridFlow(noisy.gridded(lift))

    *_, end = meshflow.march(flow, meshflow.Until(steps=300), meshflow.Explicit(), meshflow.FixedStep(dt))
    explicit = noisy.lowered(end.u)
    states = list(meshflow.march(flow, meshflow.Until(time=end.time), meshflow.SuperTime()))
    fast = noisy.lowered(states[-1].u)

    rates = sum(stages(1, state.dt / (1.0 / 6.0)) for state in states[1:])
    away = float(np.sqrt(np.mean((fast.values - explicit.values) ** 2)))
    errors = [float(np.sqrt(np.mean((image.values - truth) ** 2))) for image in (noisy, explicit, fast)]
    print(
        f"rms error {errors[0]:.1f} before, {errors[1]:.2f} after 300 explicit steps, {errors[2]:.2f} after {rates} stages;"
    )
    print(f"the two differ by {away:.3f} grey levels")
    if picture is not None:
        title = f"Figure 8: 300 explicit steps, or {rates} stages"
        meshflow.view.compare(noisy, fast, picture, size=(1400, 1000), title=title, overwrite=True)
    return rates, away


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
