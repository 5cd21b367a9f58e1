"""Photographs that come with scikit-image, as scenes beside those of ``meshflow.synthetic``."""

import numpy as np
import pytest

from meshflow.synthetic import scenes
from meshflow.synthetic.scenes import Subject


def camera():
    """Grey levels (512, 512), 0 to 255: a man with a camera."""
    return pytest.importorskip("skimage.data").camera().astype(np.float64)


def astronaut():
    """Colours (512, 512, 3), 0 to 255: an astronaut."""
    return pytest.importorskip("skimage.data").astronaut().astype(np.float64)


SCENES = {
    **scenes.SCENES,
    "camera": Subject("camera", camera, (5.0, 10.0, 20.0, 30.0), "image", "grey levels", peak=255.0),
    "astronaut": Subject("astronaut", astronaut, (10.0, 25.0), "image", "grey levels", peak=255.0),
}
