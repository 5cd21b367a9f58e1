"""Parameters of a run: value, unit, origin and reason."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import DTypeLike

from meshflow.geometry.options import nearest
from meshflow.geometry.validation import Array
from meshflow.surfaces.data import Data
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.tet_mesh import TetMesh
from meshflow.surfaces.volume import Volume

__all__ = ["Origin", "Parameter", "Parameters", "contrast_unit", "squared_unit", "value_unit"]

Origin = Literal["given", "estimated", "default"]


@dataclass(frozen=True, eq=False)
class Parameter:
    """A parameter of a run. Numeric parameters behave as numbers.

    :ivar value: a number or a word.
    :ivar unit: of a number; empty if it has none, or it is not known.
    :ivar origin: ``given | estimated | default``.
    :ivar why: the reason, if there is one.
    """

    value: float | str
    unit: str = ""
    origin: Origin = "default"
    why: str = ""

    def __str__(self) -> str:
        value = self.value if isinstance(self.value, str) else f"{self.value:.6g}"
        words = ", ".join(word for word in (self.origin, self.why) if word)
        return f"{value}{' ' + self.unit if self.unit else ''} ({words})"

    def __float__(self) -> float:
        return float(self.value)

    def __int__(self) -> int:
        return int(float(self.value))

    def __format__(self, how: str) -> str:
        return format(self.value, how) if how else str(self)

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Parameter):
            return (self.value, self.unit, self.origin, self.why) == (other.value, other.unit, other.origin, other.why)
        return self.value == other

    def __hash__(self) -> int:
        return hash(self.value)

    def __lt__(self, other: "float | Parameter") -> bool:
        return float(self) < float(other)

    def __le__(self, other: "float | Parameter") -> bool:
        return float(self) <= float(other)

    def __gt__(self, other: "float | Parameter") -> bool:
        return float(self) > float(other)

    def __ge__(self, other: "float | Parameter") -> bool:
        return float(self) >= float(other)

    def __add__(self, other: "float | Parameter") -> float:
        return float(self) + float(other)

    def __sub__(self, other: "float | Parameter") -> float:
        return float(self) - float(other)

    def __mul__(self, other: "float | Parameter") -> float:
        return float(self) * float(other)

    def __truediv__(self, other: "float | Parameter") -> float:
        return float(self) / float(other)

    def __pow__(self, other: "float | Parameter") -> float:
        return float(self) ** float(other)

    def __neg__(self) -> float:
        return -float(self)

    def __abs__(self) -> float:
        return abs(float(self))

    def __round__(self, digits: int | None = None) -> float:
        return round(float(self), digits)

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> Array:
        """The value for numpy: a number, or text."""
        return np.asarray(self.value, dtype=dtype)

    __radd__, __rmul__ = __add__, __mul__

    def __rsub__(self, other: float) -> float:
        return float(other) - float(self)

    def __rtruediv__(self, other: float) -> float:
        return float(other) / float(self)


class Parameters(dict[str, Parameter]):
    """The parameters of a run by name; an unknown name is refused with the nearest one."""

    def __missing__(self, name: str) -> Parameter:
        near = nearest(str(name), tuple(self))
        meant = f"did you mean {near}? There" if near else "there"
        raise KeyError(f"{name}: no such parameter; {meant} are {', '.join(self)}")


def value_unit(data: Data) -> str:
    """The unit of the smoothed values, if the data defines it."""
    return data.unit if isinstance(data, (HeightField, RangeImage)) else ""


def squared_unit(data: Data) -> str:
    """The unit of time."""
    if isinstance(data, RangeImage):
        return "pixel footprints²" if data.time_unit != "length" else f"{data.unit}²" if data.unit else "squared length"
    if isinstance(data, HeightField) and data.unit:
        return f"{data.unit}²"
    if isinstance(data, TetMesh):
        return f"{data.unit}²" if data.unit else "squared length"
    if isinstance(data, Volume):
        return f"{data.unit}²" if data.unit else "voxels²" if data.spacing == (1.0, 1.0, 1.0) else "squared length"
    if isinstance(data, Image) and np.ndim(data.spacing[0]) == 0 and data.spacing == (1.0, 1.0):
        return "pixels²"
    return "squared length"


def contrast_unit(data: Data) -> str:
    """The unit of the contrast; none where values and lengths have the same unit."""
    if isinstance(data, Image):
        return "pixels per unit" if squared_unit(data) == "pixels²" else "length per unit"
    if isinstance(data, Volume):
        return "voxels per unit" if squared_unit(data) == "voxels²" else "length per unit"
    return "length per unit" if isinstance(data, TetMesh) or (isinstance(data, Mesh) and data.moves != "points") else ""
