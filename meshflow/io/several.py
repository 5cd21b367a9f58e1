"""Things of several parts, each smoothed by itself: scenes of trimesh, blocks of pyvista."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from meshflow.errors import InputError
from meshflow.geometry.lift import Noun
from meshflow.io.adopt import Adopted, adopt

__all__ = ["Several", "several"]


@dataclass(frozen=True)
class Several:
    """Parts that do not influence each other.

    :param parts: name and part.
    :param restore: their nouns, in the same order, become a thing of the kind that came in; a new one.
    """

    parts: tuple[tuple[str, Adopted], ...]
    restore: Callable[[Sequence[Noun]], Any]


def several(thing: Any, **hints: Any) -> Several | None:
    """The parts of a ``trimesh.Scene`` or a ``pyvista.MultiBlock``; None for anything else.

    Of a scene the primitives of one glTF mesh are one part, and each is smoothed where its first node puts it.

    :raises InputError: for a part that is no surface, named, or a scene without one.
    """
    for kind in type(thing).__mro__:
        home = kind.__module__.partition(".")[0], kind.__name__
        if home == ("trimesh", "Scene"):
            from meshflow.io.scenes import taken_apart

            parts, restore = taken_apart(thing, **hints)
            return Several(parts, restore)
        if home == ("pyvista", "MultiBlock"):
            return _blocks(thing, hints)
    return None


def _blocks(blocks: Any, hints: dict[str, Any]) -> Several:
    """The blocks, those within blocks too; empty ones stay."""
    parts: list[tuple[str, Adopted]] = []
    inner: list[tuple[int, Several]] = []
    for i, block in enumerate(blocks):
        name = str(blocks.get_block_name(i) or i)
        if block is None:
            continue
        try:
            found = several(block, **hints) or _alone(adopt(block, **hints))
        except InputError as cause:
            raise InputError(f"block {name}: {cause}") from cause
        inner.append((i, found))
        parts += [(f"{name}/{own}" if own else name, part) for own, part in found.parts]
    if not parts:
        raise InputError("pyvista.MultiBlock: at least one block with a surface expected, got none")

    def restore(nouns: Sequence[Noun]) -> Any:
        new, start = blocks.copy(deep=True), 0
        for i, found in inner:
            stop = start + len(found.parts)
            new.replace(i, found.restore(nouns[start:stop]))
            start = stop
        return new

    return Several(tuple(parts), restore)


def _alone(adopted: Adopted) -> Several:
    return Several((("", adopted),), lambda nouns: adopted.restore(nouns[0]))
