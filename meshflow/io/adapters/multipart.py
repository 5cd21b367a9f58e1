"""Things of several parts, each smoothed by itself: scenes of trimesh, blocks of pyvista, files of several meshes."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.validation import Array
from meshflow.io.files import Document
from meshflow.io.objects import Adopted, adopt
from meshflow.surfaces.lift import Mesh, Noun

__all__ = ["Several", "several"]


@dataclass(frozen=True)
class Several:
    """Parts that do not influence each other.

    :param parts: name and part; no name twice.
    :param restore: their nouns, in the same order, become a thing of the kind that came in; a new one.
    :param whole: one number per sample may come as one array for all of them; otherwise by name alone.
    """

    parts: tuple[tuple[str, Adopted], ...]
    restore: Callable[[Sequence[Noun]], Any]
    whole: bool = False


def several(thing: Any, **hints: Any) -> Several | None:
    """The parts of a ``trimesh.Scene``, a ``pyvista.MultiBlock`` or a :class:`Document` of several; None for anything else.

    Of a scene the primitives of one glTF mesh are one part, and each is smoothed where its first node puts it.

    :raises InputError: for a part that is no surface, named, or a scene without one.
    """
    if isinstance(thing, Document):
        return _sections(thing, hints)
    for kind in type(thing).__mro__:
        home = kind.__module__.partition(".")[0], kind.__name__
        if home == ("trimesh", "Scene"):
            from meshflow.io.formats.scenes import taken_apart

            parts, restore = taken_apart(thing, **hints)
            return Several(_told_apart(parts), restore)
        if home == ("pyvista", "MultiBlock"):
            return _blocks(thing, hints)
    return None


def _sections(document: Document, hints: dict[str, Any]) -> Several | None:
    """The meshes of a file; None where there is one, or none.

    :raises InputError: as :func:`adopt`, for hints that a file says itself.
    """
    if len(document.sections) < 2:
        return None
    document = document.holding(adopt(document, **hints).noun)
    noun = document.noun
    assert isinstance(noun, Mesh)

    def restore(nouns: Sequence[Noun]) -> Document:
        points = np.array(noun.points, dtype=np.result_type(*(one.points for one in nouns if isinstance(one, Mesh))))
        channels = None
        if noun.channels is not None:
            kinds = (one.channels for one in nouns if isinstance(one, Mesh) and one.channels is not None)
            channels = np.array(noun.channels, dtype=np.result_type(*kinds))
        for (_, rows), one in zip(document.sections, nouns, strict=True):
            assert isinstance(one, Mesh)
            points[rows] = one.points
            if channels is not None:
                channels[rows] = one.channels
        return document.holding(replace(noun, points=points, channels=channels))

    parts = ((name, _section(document, noun, rows)) for name, rows in document.sections)
    return Several(_told_apart(parts), restore, whole=True)


def _section(document: Document, noun: Mesh, rows: Array) -> Adopted:
    """Some of the vertices of a file with the triangles between them, in the same order."""
    at = np.full(len(noun.points), -1)
    at[rows] = np.arange(len(rows))
    faces = at[noun.faces]
    part = replace(
        noun,
        points=noun.points[rows],
        faces=faces[(faces >= 0).all(axis=1)],
        channels=None if noun.channels is None else noun.channels[rows],
        fixed=noun.fixed[rows],
    )

    def samples(given: Any, word: str) -> Any:
        values = document.samples(given, word)
        if np.ndim(values) == 0:
            return values
        if len(values) != len(at):
            raise InputError(f"{word}: one number per vertex of the file, {len(at)}, expected, got {len(values)}")
        return np.asarray(values)[rows]

    return Adopted(part, lambda one: one, (), samples)


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

    return Several(_told_apart(parts), restore)


def _alone(adopted: Adopted) -> Several:
    return Several((("", adopted),), lambda nouns: adopted.restore(nouns[0]))


def _told_apart(parts: Any) -> tuple[tuple[str, Adopted], ...]:
    """With a number behind each name that has been there before."""
    made: dict[str, Adopted] = {}
    for name, part in parts:
        count, own = 1, name
        while own in made:
            count += 1
            own = f"{name} ({count})"
        made[own] = part
    return tuple(made.items())
