"""The picture of a wall clock, for figure 10."""

import numpy as np
from matplotlib import get_data_path
from PIL import Image as Picture
from PIL import ImageDraw, ImageFilter, ImageFont


def clock(size: int = 280, fine: int = 4) -> np.ndarray:
    """A wall clock (h, w) in grey levels: rim, figures, strokes of the minutes, hands at ten past ten."""
    s = size * fine
    drawn = Picture.new("L", (s, s), 96)
    pen, half = ImageDraw.Draw(drawn), s / 2
    font = ImageFont.truetype(f"{get_data_path()}/fonts/ttf/DejaVuSans-Bold.ttf", int(0.085 * s))

    def at(share: float, turn: float) -> tuple[float, float]:
        return half + share * half * np.sin(2 * np.pi * turn), half - share * half * np.cos(2 * np.pi * turn)

    for share, grey in ((0.94, 40), (0.86, 225)):
        pen.ellipse([half * (1 - share)] * 2 + [half * (1 + share)] * 2, fill=grey)
    for minute in range(60):
        hour = minute % 5 == 0
        pen.line([at(0.80 - 0.05 * hour, minute / 60), at(0.84, minute / 60)], 30, s // (90 if hour else 200))
    for hour in range(1, 13):
        pen.text(at(0.62, hour / 12), str(hour), 20, font, anchor="mm")
    for share, turn, wide in ((0.42, 10.17 / 12, 40), (0.66, 10 / 60, 60)):
        pen.line([at(-0.1, turn), at(share, turn)], 15, int(s / wide))
    pen.ellipse([half - 0.03 * s] * 2 + [half + 0.03 * s] * 2, fill=15)
    return np.asarray(
        drawn.filter(ImageFilter.GaussianBlur(0.4 * fine)).resize((size, size), Picture.Resampling.BOX), float
    )
