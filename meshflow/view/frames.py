"""Writes sequences of pictures: animated GIF and PNG by Pillow, films by imageio and ffmpeg."""

from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from meshflow.errors import InputError, need
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import beside

__all__ = ["ANIMATED", "FILMS", "Frames"]

ANIMATED, FILMS = (".gif", ".png"), (".mp4", ".gif")
_WHITE = 246  # brighter colours become white in a GIF, since Pillow searches colours in coarse steps
_QUALITY = 7  # of imageio, 0 to 10


class Frames:
    """A file of frames. It replaces an old file only when it is complete; after an error no file is left.

    :param path: ``.gif``; ``.png``, animated; or ``.mp4`` (H.264; needs ``meshflow[film]``).
    :param rate: frames per second.
    :raises MissingPackage: for a film where imageio-ffmpeg is not installed.
    :raises InputError: for an invalid rate.
    """

    def __init__(self, path: Path, rate: float) -> None:
        if not 0.1 <= rate <= 60:
            raise InputError(f"rate: 0.1 to 60 frames per second expected, got {rate:g}")
        if path.suffix.lower() == ".mp4":
            need("imageio_ffmpeg", "film")
        self.path, self.rate = path, rate
        self._beside = beside(path)
        self._pictures: list[Any] = []
        self._draft = path
        self._film: Any = None

    def __enter__(self) -> "Frames":
        self._draft = self._beside.__enter__()
        return self

    def add(self, picture: Array) -> None:
        """Add a frame, (h, w, 3) in uint8; all have the same size."""
        if self.path.suffix.lower() == ".mp4":
            even = np.ascontiguousarray(picture[: len(picture) // 2 * 2, : picture.shape[1] // 2 * 2])
            self._filming().append_data(even)
            return
        from PIL import Image

        self._pictures.append(Image.fromarray(picture))

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._film is not None:
            self._film.close()
        if kind is None and self._pictures:
            first, *others = _in_few_colours(self._pictures) if self._draft.suffix.lower() == ".gif" else self._pictures
            options = {"save_all": True, "append_images": others, "duration": round(1000 / self.rate), "loop": 0}
            try:
                first.save(self._draft, format=self.path.suffix[1:].upper(), **options)
            except OSError as cause:
                kind, error, trace = type(cause), cause, cause.__traceback__
        self._beside.__exit__(kind, error, trace)  # turns it into a FormatError

    def _filming(self) -> Any:
        """The pipe to ffmpeg, opened with the first frame."""
        if self._film is None:
            import imageio

            self._film = imageio.get_writer(
                self._draft, format="FFMPEG", fps=self.rate, codec="libx264", quality=_QUALITY, macro_block_size=2
            )
        return self._film


def _in_few_colours(pictures: list[Any]) -> list[Any]:
    """Pictures with a common palette, so that constant parts do not flicker; white stays white."""
    from PIL import Image

    first = pictures[0]
    some = [pictures[k] for k in sorted({0, len(pictures) // 2, len(pictures) - 1})]
    strip = Image.new("RGB", (first.width, first.height * len(some)))
    for k, picture in enumerate(some):
        strip.paste(picture, (0, k * first.height))
    palette = strip.quantize(255)
    colours = np.array([*(palette.getpalette() or [])[: 3 * 255], 255, 255, 255], np.uint8).reshape(-1, 3)
    colours[colours.min(axis=1) >= _WHITE] = 255
    palette.putpalette(colours.ravel().tolist())
    return [picture.quantize(palette=palette, dither=Image.Dither.FLOYDSTEINBERG) for picture in pictures]
