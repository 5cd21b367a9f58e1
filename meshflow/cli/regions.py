"""Regions of data as text: an expression on coordinates and attributes, such as ``sphere(0, 0, 2, 1.5) and z > 2``."""

import ast
import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from meshflow.errors import InputError
from meshflow.geometry.options import nearest
from meshflow.geometry.validation import Array
from meshflow.io.document import Document
from meshflow.surfaces.data import on_surface
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh

__all__ = ["is_region", "region"]

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
    if len(text) > LONGEST:
        raise InputError(f"{word}: an expression of at most {LONGEST} characters expected, got {len(text)}")
    there = _Names.of(document)
    try:
        tree = ast.parse(text.strip(), mode="eval").body
        with np.errstate(all="ignore"):
            found = _Reader(there, word).of(tree)
    except (SyntaxError, ValueError, MemoryError, RecursionError) as cause:
        if isinstance(cause, InputError):
            raise
        raise InputError(f"{word}: an expression expected, {_EXAMPLE}, got {text!r}") from cause
    values = np.broadcast_to(found, there.shape)
    mask = values if values.dtype == bool else np.isfinite(values) & (values != 0)
    if not mask.any():
        spans = ", ".join(f"{name} {low:.4g} to {high:.4g}" for name, (low, high) in there.spans().items())
        raise InputError(f"{word}: {text!r} is true for none of {mask.size} samples; {spans}")
    return np.array(mask)


@dataclass(frozen=True, eq=False)
class _Names:
    """The numbers per sample of a document, by name.

    :ivar shape: (h, w) or (n,).
    :ivar arrays: coordinates and channels.
    """

    document: Document
    shape: tuple[int, ...]
    arrays: Mapping[str, Array]

    @classmethod
    def of(cls, document: Document) -> "_Names":
        """The names of a document."""
        data = on_surface(document.data, "regions by an expression")
        if isinstance(data, Mesh):
            arrays = dict(zip("xyz", np.asarray(data.points, np.float64).T, strict=False))
            return cls(document, (len(data.points),), arrays)
        h, w = data.missing.shape
        row, column = np.mgrid[:h, :w].astype(np.float64)
        arrays = {"row": row, "column": column}
        if not isinstance(data, (HeightField, Image)):
            cloud = dict(zip("xyz", np.moveaxis(data.cloud, 2, 0), strict=True))
            return cls(document, (h, w), {**cloud, **arrays, "depth": np.where(data.missing, np.nan, data.depth)})
        places = document.source.places((h, w))
        dx, dy = np.broadcast_to(data.spacing[0], (h,))[:, None], data.spacing[1]
        arrays["x"], arrays["y"] = (column * dx, row * dy) if places is None else places
        planes = [data.z] if isinstance(data, HeightField) else np.moveaxis(data.values.reshape(h, w, -1), 2, 0)
        names = ["z"] if isinstance(data, HeightField) else [f"c{i}" for i in range(len(planes))]
        channels = {name: np.where(data.missing, np.nan, plane) for name, plane in zip(names, planes, strict=True)}
        return cls(document, (h, w), {**arrays, **channels})

    def __getitem__(self, name: str) -> Array | None:
        if name in self.arrays:
            return self.arrays[name]
        if not isinstance(self.document.data, Mesh):
            return None
        try:
            found = self.document.samples(name, "mobility")
        except InputError:
            return None
        return None if found is None or isinstance(found, str) else np.asarray(found, np.float64)

    def spans(self) -> dict[str, tuple[float, float]]:
        """The least and the greatest coordinates."""
        return {n: (float(np.nanmin(a)), float(np.nanmax(a))) for n, a in self.arrays.items() if n in ("x", "y", "z")}


@dataclass(frozen=True, eq=False)
class _Reader:
    """Evaluates an expression; nothing but numbers, the known names and functions is understood."""

    there: _Names
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
            what = "its coordinates" if isinstance(self.there.document.data, Mesh) else "its numbers"
            more = " and its vertex attributes" if isinstance(self.there.document.data, Mesh) else ""
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
