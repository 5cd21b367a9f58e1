"""Contrast reduction that keeps details [TT99]: a room and the view from its window, 1 : 10 000, on a screen of 1 : 100.

The logarithm of the luminance is split by low curvature image simplifiers into a base and details; the base alone is compressed.

``python examples/tone_mapping.py [PICTURE.png]`` (needs scikit-image, whose pictures are the room and the view)
"""

import sys
from pathlib import Path

import numpy as np
import skimage.data
from skimage.transform import resize

from meshflow.classics import compressed

sys.path.insert(0, str(Path(__file__).parent))
from drawing import page

CONTRASTS, BASE, TIME = (2.0, 8.0), 0.35, 300.0


def scene() -> np.ndarray:
    """Radiance (h, w, 3): a desk with a cup in the dark, and a window on a rocket in the sun, a thousand times as bright."""
    room = resize(skimage.data.coffee() / 255.0, (240, 360), anti_aliasing=True) ** 2.2
    y, x = np.mgrid[0:240, 0:360]
    radiance = room * (0.08 + 0.6 * np.exp(-((x - 90) ** 2 + (y - 150) ** 2) / 9e3))[..., None]
    view = resize(skimage.data.rocket() / 255.0, (120, 168), anti_aliasing=True) ** 2.2
    radiance[14:134, 176:344] = 120.0 * view + 1.0
    for edge in (np.s_[10:14, 172:348], np.s_[134:138, 172:348], np.s_[10:138, 172:176], np.s_[10:138, 344:348]):
        radiance[edge] = 0.05
    return radiance + 2e-3


def shown(radiance: np.ndarray, white: float) -> np.ndarray:
    """Grey levels of a screen (h, w, 3)."""
    return 255.0 * np.clip(radiance / white, 0.0, 1.0) ** (1.0 / 2.2)


def main(picture: Path | None = None) -> float:
    """How many times less the contrast of the result is, 1st to 99th percentile."""
    radiance = scene()
    luminance = radiance @ (0.2126, 0.7152, 0.0722)
    result = np.exp(compressed(np.log(luminance), CONTRASTS, BASE, TIME))
    mapped = radiance * (result / luminance)[..., None]
    span = [float(np.divide(*np.percentile(light, [99, 1]))) for light in (luminance, result)]
    print(f"contrast 1 : {span[0]:.0f} before, 1 : {span[1]:.0f} after")
    if picture is not None:
        whole, dark = float(np.percentile(luminance, 99.5)), float(np.percentile(luminance[140:], 98))
        panels = [("exposed for the window", shown(radiance, whole)), ("exposed for the room", shown(radiance, dark)),
                  ("LCIS: base compressed, details kept", shown(mapped, float(np.percentile(result, 99))))]  # fmt: skip
        page(panels, picture, "Low curvature image simplifiers: 1 : 10 000 on a screen", tall=240 / 360)
    return span[0] / span[1]


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
