"""Imports blocks of pyvista as parts."""

from collections.abc import Sequence

import pyvista

from meshflow.errors import InputError
from meshflow.io.adapters.pyvista import from_object
from meshflow.io.document import Imported, Multipart, distinct_names
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.data import Data

__all__ = ["from_blocks"]


def from_blocks(blocks: pyvista.MultiBlock, options: ReadOptions) -> Multipart:
    """The blocks, including nested ones; empty blocks are kept."""
    parts: list[tuple[str, Imported]] = []
    inner: list[tuple[int, Multipart]] = []
    for i, block in enumerate(blocks):
        name = str(blocks.get_block_name(i) or i)
        if block is None:
            continue
        try:
            found = (
                from_blocks(block, options)
                if isinstance(block, pyvista.MultiBlock)
                else _alone(from_object(block, options))
            )
        except InputError as cause:
            raise InputError(f"block {name}: {cause}") from cause
        inner.append((i, found))
        parts += [(f"{name}/{own}" if own else name, part) for own, part in found.parts]
    if not parts:
        raise InputError("pyvista.MultiBlock: at least one block with a surface expected, got none")

    def to_object(surfaces: Sequence[Data]) -> pyvista.MultiBlock:
        """The blocks with the smoothed parts."""
        new, start = blocks.copy(deep=True), 0
        for i, found in inner:
            stop = start + len(found.parts)
            new.replace(i, found.to_object(surfaces[start:stop]))
            start = stop
        return new

    return Multipart(distinct_names(parts), to_object)


def _alone(imported: Imported) -> Multipart:
    return Multipart((("", imported),), lambda surfaces: imported.to_object(surfaces[0]))
