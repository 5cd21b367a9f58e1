"""The method with the least estimated risk, or one fixed choice for all data."""

from dataclasses import dataclass
from typing import ClassVar

from meshflow.flow.methods.beltrami import HeightMethod
from meshflow.flow.methods.points import Along
from meshflow.geometry.options import named_fields, option

__all__ = ["Quick", "Search"]


@named_fields
@dataclass(frozen=True, kw_only=True)
class Search(HeightMethod):
    """The method with the smallest estimated error, among those that suit the data. Options given here are kept."""

    word: ClassVar[str] = "search"
    conserves: ClassVar[str] = "whatever the chosen method conserves"

    along: Along = option("all", "Points move in all directions, or only along their normals.")
    blend: bool = option(
        False,
        "Average the best two or three runs with the weights of least estimated error (height fields and images only).",
    )


@named_fields
@dataclass(frozen=True, kw_only=True)
class Quick(Search):
    """One fixed choice for all data, without a search."""

    word: ClassVar[str] = "quick"
    conserves: ClassVar[str] = "nothing"
