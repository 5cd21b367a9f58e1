"""Figure 7 of the paper: computer-generated images, grey and colour, with noise and without.

``python examples/paper_7_synthetic.py [PICTURE.png]``
"""

import sys
from pathlib import Path

import numpy as np

import meshflow
import meshflow.view
from meshflow.surfaces.image import Image
from meshflow.synthetic.samples import picture as discs


def main(picture: Path | None = None) -> float:
    """The larger of the two rms errors after over before."""
    colour = discs(noise=25.0)
    truth = colour.truth.astype(float)
    grey = truth.mean(axis=2)
    noisy = Image(grey + 25.0 * np.random.default_rng(1).normal(size=grey.shape)), Image(colour.noisy.astype(float))

    smoothed = [meshflow.smooth(image) for image in noisy]

    def rms(image: Image, true: np.ndarray) -> float:
        return float(np.sqrt(np.mean((image.values - true) ** 2)))

    shares = []
    for name, before, after, true in zip(("grey", "colour"), noisy, smoothed, (grey, truth), strict=True):
        shares.append(rms(after, true) / rms(before, true))
        print(f"{name}: rms error {rms(before, true):.1f} before, {rms(after, true):.1f} after")
    if picture is not None:
        pairs = [
            Image(np.concatenate([np.repeat(one.values[..., None], 3, axis=2), other.values]))
            for one, other in (noisy, smoothed)
        ]
        meshflow.view.compare(
            *pairs, picture, size=(1400, 1000), title="Figure 7: synthetic images, grey and colour", overwrite=True
        )
    return max(shares)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
