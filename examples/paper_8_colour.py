"""Figure 8 of the paper as printed: a noisy colour photograph after 300 explicit steps with dt = 1, gamma = 0.

The paper's scheme takes the ring of eight triangles around each sample; dt = 1 is then the limit of explicit steps.
Super-time-stepping of the same flow on all triangles of the grid reaches the same time in a sixth of the rates.

``python examples/paper_8_colour.py [PICTURE.png]`` (needs scikit-image)
"""

import sys
from pathlib import Path

import numpy as np
import skimage.data

import meshflow
from meshflow.flow.super_time import stages
from meshflow.surfaces.image import Image

sys.path.insert(0, str(Path(__file__).parent))
from drawing import page

CONTRAST = 0.4  # alpha of section 4.4, which the figure does not print


def rms(image: Image, other: np.ndarray) -> float:
    """Root mean square difference, grey levels."""
    return float(np.sqrt(np.mean((image.values - other) ** 2)))


def main(picture: Path | None = None) -> tuple[int, float]:
    """Rates that super-time-stepping needs for 300 explicit steps, and how far its result is from theirs, rms, in grey levels."""
    truth = skimage.data.astronaut()[30:190, 140:330].astype(float)
    noisy = Image(truth + 20.0 * np.random.default_rng(0).normal(size=truth.shape))

    once = meshflow.Compute(stepper="explicit", dt=1.0)
    printed = meshflow.smooth(
        noisy, method=meshflow.PaperScheme(contrast=CONTRAST), stop=meshflow.Steps(300), compute=once
    )
    flow = meshflow.GridFlow(noisy.gridded(meshflow.Lift(contrast=CONTRAST, boundary="neumann")))
    *_, end = meshflow.march(flow, meshflow.Until(steps=300), meshflow.Explicit(), meshflow.FixedStep(1.0 / 24.0))
    explicit = noisy.lowered(end.u)
    states = list(meshflow.march(flow, meshflow.Until(time=end.time), meshflow.SuperTime()))
    fast = noisy.lowered(states[-1].u)
    rates = sum(stages(1, state.dt / (1.0 / 6.0)) for state in states[1:])
    away = rms(fast, explicit.values)
    print(f"rms error {rms(noisy, truth):.1f} before, {rms(printed, truth):.2f} after 300 steps as printed")
    print(f"{rates} stages of super-time-stepping and 300 explicit steps differ by {away:.3f} grey levels")
    if picture is not None:
        panels = [("(a) noisy", noisy.values), ("(b) 300 explicit steps, dt = 1, gamma = 0", printed.values)]
        page(panels, picture, "Figure 8 as printed", columns=2, tall=160 / 190)
    return rates, away


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
