"""Pictures of Pillow come back as such: the same mode, size and transparency, and less noise."""

import numpy as np
import pytest
from PIL import Image as Picture

import meshflow
from meshflow.errors import InputError

RAMP = 60 + np.add.outer(np.arange(48.0), 1.5 * np.arange(64.0))


def noisy(shape, seed=0, scale=1.0):
    noise = np.random.default_rng(seed).normal(0, 6 * scale, (*RAMP.shape, *shape))
    return (RAMP.reshape(*RAMP.shape, *(1 for _ in shape)) * scale + noise).round()


@pytest.mark.long
@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "LA", "I;16", "I", "F"])
def test_a_picture_comes_back_in_its_mode_with_less_noise(mode):
    count = {"RGB": 3, "RGBA": 4, "LA": 2}.get(mode)
    scale = 100.0 if mode in ("I;16", "I") else 1.0
    values = noisy((count,) if count else (), scale=scale)
    if mode in ("RGBA", "LA"):
        values[..., -1] = np.arange(64)
    dtype = {"I;16": np.uint16, "I": np.int32, "F": np.float32}.get(mode, np.uint8)
    values = np.clip(values, 0, None if mode == "F" else np.iinfo(dtype).max).astype(dtype)
    before = Picture.frombytes(mode, (64, 48), values.tobytes())
    before.info["dpi"] = (300, 300)
    kept = before.tobytes()
    after = meshflow.smooth(before)
    assert (after.mode, after.size, after.info["dpi"]) == (mode, (64, 48), (300, 300))
    assert before.tobytes() == kept
    done = np.asarray(after).astype(float)
    truth = RAMP * scale if done.ndim == 2 else (RAMP * scale)[..., None]
    colours = done if done.ndim == 2 else done[..., : {"RGB": 3, "RGBA": 3, "LA": 1}[mode]]
    assert np.sqrt(np.mean((colours - truth) ** 2)) < 3 * scale
    if mode in ("RGBA", "LA"):
        np.testing.assert_array_equal(done[..., -1], values[..., -1])


def test_what_holds_no_intensities_is_refused_with_what_to_convert_to():
    for mode in ("P", "1", "CMYK"):
        with pytest.raises(InputError, match=r"convert\('RGB'\)"):
            meshflow.smooth(Picture.new(mode, (20, 20)))
    with pytest.raises(InputError, match="is an image"):
        meshflow.smooth(Picture.new("L", (20, 20)), kind="terrain")
