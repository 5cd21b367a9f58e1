"""Figure 10 of the paper: a noisy picture of a clock, as an image and as a height field, before and after the paper's flow.

``python examples/paper_10_clock.py [PICTURE.png]``
"""

import sys
from pathlib import Path

import numpy as np

import meshflow
from meshflow.surfaces.image import Image
from meshflow.view.look import looking
from meshflow.view.scene import of_one

sys.path.insert(0, str(Path(__file__).parent))
from clock import clock
from drawing import page

NOISE = 14.0


def main(picture: Path | None = None) -> float:
    """The rms error after over that before, of noise that was added."""
    truth = clock()
    noisy = Image(truth + NOISE * np.random.default_rng(0).normal(size=truth.shape))
    smoothed = meshflow.smooth(noisy, method="beltrami")
    errors = [float(np.sqrt(np.mean((image.values - truth) ** 2))) for image in (noisy, smoothed)]
    print(f"clock: rms error {errors[0]:.1f} before, {errors[1]:.1f} after")
    if picture is not None:
        look, words = looking(seen="side", altitude=35), ("noisy", "after the Beltrami flow")
        panels = [(word, image.values) for word, image in zip(words, (noisy, smoothed), strict=True)]
        panels += [("as a height field", of_one(image, look).picture(0, (900, 760))) for image in (noisy, smoothed)]
        page(panels, picture, "Figure 10: the clock", columns=2, tall=0.84)
    return errors[1] / errors[0]


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
