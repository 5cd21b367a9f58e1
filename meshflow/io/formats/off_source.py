"""What a text and a binary OFF have in common once they were read."""

from dataclasses import dataclass

from numpy.typing import ArrayLike

from meshflow.errors import Fact
from meshflow.geometry.validation import Array
from meshflow.io.document import MeshSource
from meshflow.io.metadata import ReadOptions
from meshflow.io.vertex_merging import Skin, is_soup

__all__ = ["OffSource", "skin_of"]


@dataclass(frozen=True, eq=False)
class OffSource(MeshSource):
    """An OFF that was read.

    :param skin: its triangles.
    """

    skin: Skin

    def writes(self, suffix: str) -> bool:
        """Whether it is ``.off``."""
        return suffix == ".off"

    def samples(self, given: ArrayLike | None, word: str) -> ArrayLike | None:
        """An array of one number per vertex; an OFF file has no named attributes."""
        return self.skin.samples(given, word, lambda name: (None, ()))


def skin_of(points: Array, triangles: Array, polygons: int, options: ReadOptions) -> tuple[Skin, tuple[str, ...]]:
    """The triangles of a file, and notes on what was done with its polygons.

    :param points: (n, 3).
    :param triangles: (m, 3), of the polygons.
    :param polygons: their number.
    """
    skin = Skin.of(points, triangles, split=is_soup(triangles, len(points)), moves=options.moves)
    if polygons == len(triangles):
        return skin, skin.note
    said = f"{polygons} polygons are smoothed as {len(triangles)} triangles; an OFF written again keeps the polygons"
    return skin, (*skin.note, Fact(said))
