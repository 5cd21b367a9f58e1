"""A list of words in a window of VTK, of which one is chosen by a click."""

from collections.abc import Callable, Sequence
from typing import Any

__all__ = ["Choices"]

# The height of a row and of letters, as shares of the height of the window; the number of columns.
ROW, LETTER, COLUMNS = 0.024, 0.0135, 2
PLAIN, CHOSEN = "#6b7075", "#2b6cb0"


class Choices:
    """Words in rows, the chosen one in blue; a click on another chooses it.

    :ivar value: the chosen word.
    :param place: left, right and upper end, as shares of the window.
    :param chosen: called with the word that is clicked.
    """

    def __init__(
        self,
        plotter: Any,
        words: Sequence[str],
        value: str,
        place: tuple[float, float, float],
        chosen: Callable[[str], None],
    ) -> None:
        self.value, self._plotter, self._words, self._chosen = value, plotter, tuple(words), chosen
        self._left, self._right, self._top = place
        self._actors: list[Any] = [self._actor(k, word) for k, word in enumerate(self._words)]
        self._shown()
        # Before the camera's own, which would begin to turn the surface.
        self._observer: Any = plotter.iren.add_observer("LeftButtonPressEvent", self._clicked)

    @staticmethod
    def height(count: int) -> float:
        """The height of a list of so many words, as a share of the window."""
        return ROW * -(-count // COLUMNS)

    def Off(self) -> None:  # noqa: N802 - as the widgets of VTK have it
        """Take the list away."""
        self._plotter.iren.remove_observer(self._observer)
        for actor in self._actors:
            self._plotter.renderers[0].RemoveViewProp(actor)

    def at(self, x: float, y: float) -> str | None:
        """The word at a place of the window, in shares of it from the lower left; None beside them."""
        row, column = int((self._top - y) // ROW), int((x - self._left) // self._wide)
        if not (0 <= column < COLUMNS and 0 <= row < self._rows and self._top >= y):
            return None
        k = column * self._rows + row
        return self._words[k] if k < len(self._words) else None

    def click(self, x: float, y: float) -> None:
        """Choose the word at a place of the window, if there is one."""
        word = self.at(x, y)
        if word is not None and word != self.value:
            self.value = word
            self._shown()
            self._chosen(word)

    @property
    def _rows(self) -> int:
        return -(-len(self._words) // COLUMNS)

    @property
    def _wide(self) -> float:
        return (self._right - self._left) / COLUMNS

    def _clicked(self, *_: object) -> None:
        x, y = self._plotter.iren.get_event_position()
        width, height = self._plotter.window_size
        self.click(x / width, y / height)

    def _shown(self) -> None:
        for word, actor in zip(self._words, self._actors, strict=True):
            text = actor.GetTextProperty()
            text.SetBold(word == self.value)
            text.SetColor(*_rgb(CHOSEN if word == self.value else PLAIN))

    def _actor(self, k: int, word: str) -> Any:
        """The text of a word, as high as its row at any size of the window."""
        import vtk

        column, row = divmod(k, self._rows)
        actor = vtk.vtkTextActor()
        actor.SetInput(word)
        actor.SetTextScaleModeToNone()
        text = actor.GetTextProperty()
        text.SetFontSize(max(round(LETTER * self._plotter.window_size[1]), 8))
        text.SetVerticalJustificationToCentered()
        renderer = self._plotter.renderers[0]
        left, bottom, right, top = renderer.GetViewport()
        actor.GetPositionCoordinate().SetCoordinateSystemToNormalizedViewport()
        x = self._left + column * self._wide
        y = self._top - (row + 0.5) * ROW
        actor.SetPosition((x - left) / (right - left), (y - bottom) / (top - bottom))
        renderer.AddViewProp(actor)
        return actor


def _rgb(colour: str) -> tuple[float, ...]:
    return tuple(int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
