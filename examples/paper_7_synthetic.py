"""Figure 7 of the paper: computer-generated images, grey and colour, with noise and without, and a close-up.

``python examples/paper_7_synthetic.py [PICTURE.png]``
"""

import sys
from pathlib import Path

import numpy as np

import meshflow
from meshflow.surfaces.image import Image
from meshflow.synthetic.samples import picture as discs

sys.path.insert(0, str(Path(__file__).parent))
from drawing import page


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
        near = np.s_[40:73, 45:89]
        panels = []
        for k, (a, b, c) in enumerate((("(a)", "(b)", "(c)"), ("(d)", "(e)", "(f)"))):
            one, two = noisy[k].values, smoothed[k].values
            panels += [(f"{a} noisy", one), (f"{b} denoised", two)]
            panels += [(f"{c} close-up of {a}", one[near]), (f"close-up of {b}", two[near])]
        page(panels, picture, "Figure 7: computer-generated images, grey and colour", columns=4, tall=0.75)
    return max(shares)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
