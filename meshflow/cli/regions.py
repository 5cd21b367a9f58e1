"""Regions of data as text: an expression on coordinates and attributes, such as ``sphere(0, 0, 2, 1.5) and z > 2``."""

import ast
import operator
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.options import nearest
from meshflow.geometry.validation import Array, Spacing
from meshflow.io.document import Document
from meshflow.surfaces.data import on_surface
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh

__all__ = ["Names", "is_region", "region", "region_by_parts"]

# The longest text: parsing nested brackets takes memory.
LONGEST = 2000
_OPERATORS: Mapping[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
    ast.Pow: operator.pow,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
_FUNCTIONS: Mapping[str, Callable[..., Any]] = {
    "abs": np.abs,
    "sqrt": np.sqrt,
    "hypot": np.hypot,
    "sin": np.sin,
    "cos": np.cos,
    "atan2": np.arctan2,
    "degrees": np.degrees,
    "min": lambda *of: reduce(np.minimum, of),
    "max": lambda *of: reduce(np.maximum, of),
}
_EXAMPLE = "such as 'z > 2 and x < 10', 'box(0, 0, 0, 1, 1, 1)' or 'not sphere(0, 0, 0, 2)'"


def is_region(text: str) -> bool:
    """Whether a text is an expression, and neither the name of a file nor of an attribute: it compares or calls."""
    try:
        found = ast.parse(text.strip(), mode="eval").body if len(text) <= LONGEST else None
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        return any(sign in text for sign in "<>=(")
    if found is None or isinstance(found, (ast.Compare, ast.BoolOp)):
        return True
    named = any(isinstance(node, ast.Attribute) for node in ast.walk(found))  # a-1.npy
    return not named and isinstance(found, (ast.Call, ast.UnaryOp, ast.BinOp))


def region(document: Document, text: str, word: str) -> Array:
    """The samples for which an expression is true, a mask (h, w) or (n,).

    Names are the coordinates ``x y z`` (of a raster those on its map), of grids ``row column``, of images the channels ``c0 c1
    ...``, of depths ``depth``, and the vertex attributes of a mesh. ``box(x, y, z, x, y, z)`` holds what lies between two
    corners, ``sphere(x, y, z, radius)`` what lies around a point.

    :param word: the option, for the messages.
    :raises InputError: for text that is no such expression, an unknown name, and an expression that is true nowhere.
    """
    there = Names.of(document)
    return region_by_parts([(tuple(slice(0, size) for size in there.shape), there)], there.shape, text, word)


def region_by_parts(
    parts: "Iterable[tuple[tuple[slice, ...], Names]]", shape: tuple[int, ...], text: str, word: str
) -> Array:
    """:func:`region` of data that comes part by part.

    :param parts: the place of each, and its numbers; ``shape``: of all.
    """
    if len(text) > LONGEST:
        raise InputError(f"{word}: an expression of at most {LONGEST} characters expected, got {len(text)}")
    mask, spans = np.zeros(shape, bool), dict[str, tuple[float, float]]()
    for part, there in parts:
        mask[part] = _true_in(there, text, word)
        for name, (low, high) in there.spans().items():
            least, most = spans.get(name, (low, high))
            spans[name] = float(np.fmin(least, low)), float(np.fmax(most, high))
    if not mask.any():
        said = ", ".join(f"{name} {low:.4g} to {high:.4g}" for name, (low, high) in spans.items())
        raise InputError(f"{word}: {text!r} is true for none of {mask.size} samples; {said}")
    return mask


def _true_in(there: "Names", text: str, word: str) -> Array:
    """Where an expression is true."""
    try:
        tree = ast.parse(text.strip(), mode="eval").body
        with np.errstate(all="ignore"):
            values = np.broadcast_to(_Reader(there, word).of(tree), there.shape)
    except (SyntaxError, ValueError, MemoryError, RecursionError) as cause:
        if isinstance(cause, InputError):
            raise
        raise InputError(f"{word}: an expression expected, {_EXAMPLE}, got {text!r}") from cause
    return values if values.dtype == bool else np.isfinite(values) & (values != 0)


@dataclass(frozen=True, eq=False)
class Names:
    """The numbers per sample of data, by name.

    :ivar shape: (h, w) or (n,).
    :ivar arrays: coordinates and channels.
    :ivar mesh: with further numbers, its vertex attributes; None: it is no mesh.
    """

    shape: tuple[int, ...]
    arrays: Mapping[str, Array]
    mesh: Document | None = None

    @classmethod
    def of(cls, document: Document) -> "Names":
        """The names of a document."""
        data = on_surface(document.data, "regions by an expression")
        if isinstance(data, Mesh):
            arrays = dict(zip("xyz", np.asarray(data.points, np.float64).T, strict=False))
            return cls((len(data.points),), arrays, document)
        h, w = data.missing.shape
        part = slice(0, h), slice(0, w)
        if not isinstance(data, (HeightField, Image)):
            cloud = dict(zip("xyz", np.moveaxis(data.cloud, 2, 0), strict=True))
            row, column = np.mgrid[part].astype(np.float64)
            depth = np.where(data.missing, np.nan, data.depth)
            return cls((h, w), {**cloud, "row": row, "column": column, "depth": depth})
        values = data.z if isinstance(data, HeightField) else data.values.reshape(h, w, -1)
        return cls.on_grid(values, data.missing, part, data.spacing, document.source.places(part))

    @classmethod
    def on_grid(
        cls,
        values: Array,
        missing: Array,
        part: tuple[slice, slice],
        spacing: Spacing,
        places: tuple[Array, Array] | None,
    ) -> "Names":
        """The names of a part of a grid.

        :param values: heights (r, c), or channels (r, c, k); ``missing``: (r, c).
        :param part: its rows and columns.
        :param spacing: of the whole, (dx, dy), dx a number or one per row.
        :param places: x and y on a map; None: there is none.
        """
        row, column = np.mgrid[part].astype(np.float64)
        dx = spacing[0] if np.ndim(spacing[0]) == 0 else np.asarray(spacing[0])[part[0], None]
        x, y = (column * dx, row * spacing[1]) if places is None else places
        named = {"z": values} if values.ndim == 2 else {f"c{i}": values[..., i] for i in range(values.shape[2])}
        channels = {name: np.where(missing, np.nan, plane) for name, plane in named.items()}
        return cls(missing.shape, {"row": row, "column": column, "x": x, "y": y, **channels})

    def __getitem__(self, name: str) -> Array | None:
        if name in self.arrays:
            return self.arrays[name]
        if self.mesh is None:
            return None
        try:
            found = self.mesh.samples(name, "mobility")
        except InputError:
            return None
        return None if found is None or isinstance(found, str) else np.asarray(found, np.float64)

    def spans(self) -> dict[str, tuple[float, float]]:
        """The least and the greatest coordinates."""
        named = {name: self.arrays[name] for name in "xyz" if name in self.arrays}
        return {n: (float(np.fmin.reduce(a, axis=None)), float(np.fmax.reduce(a, axis=None))) for n, a in named.items()}


@dataclass(frozen=True, eq=False)
class _Reader:
    """Evaluates an expression; nothing but numbers, the known names and functions is understood."""

    there: Names
    word: str

    def of(self, node: ast.AST) -> Any:
        """The value of a part of the expression: a number or an array, of numbers or of truth values."""
        match node:
            case ast.Constant(value=bool() | int() | float() as number):
                return np.float64(number)
            case ast.Name():
                return self._named(node.id)
            case ast.BinOp(op=ast.BitAnd() | ast.BitOr()):
                return self._joined(isinstance(node.op, ast.BitAnd), (node.left, node.right))
            case ast.BinOp() if type(node.op) in _OPERATORS:
                return _OPERATORS[type(node.op)](self.of(node.left) * 1.0, self.of(node.right) * 1.0)
            case ast.UnaryOp(op=ast.Not() | ast.Invert()):
                return np.logical_not(self._true(node.operand))
            case ast.UnaryOp(op=ast.USub() | ast.UAdd()):
                return self.of(node.operand) * (-1.0 if isinstance(node.op, ast.USub) else 1.0)
            case ast.BoolOp():
                return self._joined(isinstance(node.op, ast.And), tuple(node.values))
            case ast.Compare():
                return self._compared(node)
            case ast.Call(func=ast.Name(id=name), keywords=[]):
                return self._called(name, [self.of(argument) for argument in node.args])
        raise InputError(f"{self.word}: an expression expected, {_EXAMPLE}, got {ast.unparse(node)!r}")

    def _true(self, node: ast.AST) -> Any:
        value = self.of(node)
        return value if np.asarray(value).dtype == bool else np.isfinite(value) & (value != 0)

    def _joined(self, every: bool, parts: tuple[ast.AST, ...]) -> Any:
        return reduce(np.logical_and if every else np.logical_or, [self._true(part) for part in parts])

    def _compared(self, node: ast.Compare) -> Any:
        found, one = [], self.of(node.left)
        for sign, part in zip(node.ops, node.comparators, strict=True):
            if type(sign) not in _OPERATORS:
                raise InputError(f"{self.word}: < <= > >= == or != expected in {ast.unparse(node)!r}")
            other = self.of(part)
            found.append(_OPERATORS[type(sign)](one, other))
            one = other
        return reduce(np.logical_and, found)

    def _named(self, name: str) -> Array:
        array = self.there[name]
        if array is None:
            names = list(self.there.arrays)
            near = nearest(name, [*names, *_FUNCTIONS, "box", "sphere"])
            what = "its numbers" if self.there.mesh is None else "its coordinates"
            more = "" if self.there.mesh is None else " and its vertex attributes"
            hint = f"; did you mean {near}?" if near else ""
            raise InputError(f"{self.word}: no {name!r} in the data, {what} are {', '.join(names)}{more}{hint}")
        return array

    def _called(self, name: str, given: list[Any]) -> Any:
        if name in ("box", "sphere"):
            return self._solid(name, given)
        if name not in _FUNCTIONS:
            raise InputError(f"{self.word}: no function {name}; there are box, sphere, {', '.join(_FUNCTIONS)}")
        try:
            return _FUNCTIONS[name](*given)
        except TypeError as cause:
            raise InputError(f"{self.word}: {name} takes other numbers than {len(given)} ({cause})") from cause

    def _solid(self, name: str, given: list[Any]) -> Any:
        axes = [axis for axis in "xyz" if axis in self.there.arrays]
        flat = len(given) == (4 if name == "box" else 3)
        axes = axes[:2] if flat else axes
        want = 2 * len(axes) if name == "box" else len(axes) + 1
        if len(given) != want or any(np.ndim(number) for number in given):
            shape = "x, y, z, x, y, z" if name == "box" else "x, y, z, radius"
            raise InputError(
                f"{self.word}: {name}({shape}) of plain numbers expected, or without z, got {len(given)} of them"
            )
        places = [self.there.arrays[axis] for axis in axes]
        if name == "sphere":
            return np.sqrt(sum(np.square(a - at) for a, at in zip(places, given, strict=False))) <= given[-1]
        pairs = zip(places, given[: len(axes)], given[len(axes) :], strict=True)
        return reduce(np.logical_and, [(min(p, q) <= a) & (a <= max(p, q)) for a, p, q in pairs])
