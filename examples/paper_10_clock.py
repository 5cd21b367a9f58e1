"""Figure 10 of the paper: a noisy photograph of a clock as a height field, before and after.

``python examples/paper_10_clock.py [PICTURE.png]`` (needs scikit-image)
"""

import sys
from pathlib import Path

import numpy as np
import skimage.data

import meshflow
import meshflow.view
from meshflow.surfaces.image import Image


def main(picture: Path | None = None) -> float:
    """The rms error after over that before, of noise that was added."""
    truth = skimage.data.clock()[40:260, 90:330].astype(float)
    noisy = Image(truth + 6.0 * np.random.default_rng(0).normal(size=truth.shape))

    smoothed = meshflow.smooth(noisy, method="patches")

    before, after = (float(np.sqrt(np.mean((image.values - truth) ** 2))) for image in (noisy, smoothed))
    print(f"clock: rms error {before:.1f} before, {after:.1f} after")
    if picture is not None:
        size, title = (1400, 1000), "Figure 10: the clock"
        meshflow.view.compare(noisy, smoothed, picture, size=size, title=title, overwrite=True)
        aslant = picture.with_stem(f"{picture.stem}_heights")
        meshflow.view.compare(
            noisy,
            smoothed,
            aslant,
            size=size,
            seen="side",
            title=f"{title} as a height field",
            altitude=35,
            overwrite=True,
        )
    return after / before


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
