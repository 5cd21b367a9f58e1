"""Vectors and symmetric tensors in files: .npy, .npz, NIfTI, NRRD; components come back in the order of the file."""

import gzip
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from meshflow.errors import FormatError, InputError, need
from meshflow.geometry.validation import Array
from meshflow.io.atomic_write import beside
from meshflow.io.document import Document, Source, WriteOptions
from meshflow.io.formats import arrays, volumes
from meshflow.io.formats.fields import Field, field_of
from meshflow.io.metadata import ReadOptions
from meshflow.io.suffixes import suffix_of
from meshflow.surfaces.image import Image
from meshflow.surfaces.volume import Volume

__all__ = ["SUFFIXES", "can_write", "read", "write"]

NAME: str = "a field of vectors or tensors"
READS: tuple[str, ...] = ("kind", "spacing", "nodata", "unit")
WRITES: tuple[str, ...] = ()
SUFFIXES = (".npy", ".npz", *volumes.NIFTI, ".nrrd")
# The rows and columns of six components: of NIfTI the lower triangle by rows, of NRRD the upper one.
_LOWER = ((0, 0), (1, 0), (1, 1), (2, 0), (2, 1), (2, 2))
_UPPER = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
# The intent of symmetric matrices in NIfTI; axes of NRRD that hold components.
_SYMMETRIC = "symmetric matrix"
_AXES = {
    "3D-symmetric-matrix": "six", "3D-masked-symmetric-matrix": "masked", "vector": "plain", "2-vector": "plain",
    "3-vector": "plain", "3-gradient": "plain", "covariant-vector": "plain", "3-normal": "plain", "list": "plain",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class FieldFile(Source):
    """What a file contains besides the components.

    :param field: as it was read.
    :param suffix: of the file.
    :param stored: from the components of a field to the array of the file.
    :param save: writes an array of the file with its header.
    """

    field: Field
    suffix: str
    stored: Callable[[Array], Array]
    save: Callable[[Array, Path], None]


def read(path: Path, options: ReadOptions) -> Document:
    """Read a file of vectors or tensors, as ``kind`` says.

    NIfTI: (x, y, z, 3) or (x, y, z, 1, 3) vectors; (x, y, z, 3, 3) tensors, or (x, y, z, 1, 6) with the intent of symmetric
    matrices. NRRD: the kind of its axes says which one holds components.

    :param options: ``spacing``, ``nodata``, ``unit``.
    :raises FormatError: for a file that cannot be read.
    :raises InputError: for components of unknown order.
    """
    suffix = suffix_of(path)
    if suffix not in SUFFIXES:
        raise InputError(f"{path.name}: kind={options.kind!r} is read from {', '.join(SUFFIXES)}")
    values, affine, stored, save = _of_arrays(path) if suffix in (".npy", ".npz") else _of_header(path, options)
    if affine is not None and options.spacing is None:
        steps = volumes.spacing_along(path, affine)
        options = replace(options, spacing=steps if values.shape[2] > 1 else (steps[1], steps[0]))
    flat = affine is not None and values.shape[2] == 1
    field = field_of(values[:, :, 0] if flat else values, options)

    def whole(components: Array) -> Array:
        """The components in the layout of the file."""
        return stored(components[:, :, None] if flat else components)

    return Document(field.image, path, FieldFile(field, suffix, whole, save))


def can_write(document: Document, suffix: str) -> bool:
    """Whether it is a field from a file of this kind; any goes into an array file."""
    return isinstance(document.source, FieldFile) and suffix in (document.source.suffix, ".npy")


def write(document: Document, path: Path, options: WriteOptions) -> tuple[str, ...]:
    """Write the components with the header of the file that they came from; as ``.npy`` in the layout of the field.

    :param options: tags cannot be stored.
    :raises FormatError: for data that came from elsewhere.
    """
    source, data = document.source, document.data
    if not isinstance(source, FieldFile) or not isinstance(data, (Image, Volume)):
        raise FormatError(f"{path.name}: a field of vectors or tensors expected, got a {document.kind}")
    values = np.array(source.field.holding(data).values)
    with beside(path) as temporary:
        if suffix_of(path) == source.suffix:
            source.save(source.stored(values), temporary)
        else:
            _save_array({}, "values", values, temporary)
    return ()


Read = tuple[Array, Array | None, Callable[[Array], Array], Callable[[Array, Path], None]]


def _of_arrays(path: Path) -> Read:
    """The array of a file, and what saves it."""
    found = arrays.loaded(path)
    key = arrays.key_of(path, found)
    values = found.pop(key)
    return values, None, lambda components: components, partial(_save_array, found, key)


def _save_array(others: dict[str, Array], key: str, values: Array, path: Path) -> None:
    """Write ``.npy``, or ``.npz`` with the other arrays of the file."""
    content = BytesIO()  # numpy itself does not say why a disk takes no more
    if others or path.suffix.lower().startswith(".npz"):
        np.savez_compressed(content, allow_pickle=False, **{**others, key: values})
    else:
        np.save(content, values, allow_pickle=False)
    path.write_bytes(content.getbuffer())


def _of_header(path: Path, options: ReadOptions) -> Read:
    """The components of a NIfTI or a NRRD, last, and what saves them."""
    return _nifti(path, options) if suffix_of(path) in volumes.NIFTI else _nrrd(path, options)


def _nifti(path: Path, options: ReadOptions) -> Read:
    samples, affine, source = volumes.nifti_opened(path)
    try:
        raw = np.asanyarray(samples)
    except (OSError, EOFError, ValueError) as cause:
        raise volumes.broken(path, cause) from cause
    image = source.image
    values = raw[:, :, :, 0] if raw.ndim == 5 and raw.shape[3] == 1 else raw
    six = options.kind == "tensors" and values.ndim == 4 and values.shape[3] == 6
    if six and image.header.get_intent()[0] != _SYMMETRIC:
        raise InputError(
            f"{path.name}: six volumes without the intent of symmetric matrices, whose order differs between programs (FSL: xx "
            "xy xz yy yz zz; MRtrix: xx yy zz xy xz yz); store matrices (x, y, z, 3, 3) as .npy"
        )

    def stored(components: Array) -> Array:
        """The samples of the file."""
        found = np.stack([components[..., i, j] for i, j in _LOWER], axis=-1) if six else components
        return found.reshape(raw.shape)

    def save(found: Array, to: Path) -> None:
        """Write them with the header of the file."""
        header = image.header.copy()
        kind = found.dtype if np.dtype(source.dtype).kind != "f" else np.dtype(source.dtype)
        header.set_data_dtype(kind)
        header.set_slope_inter(1.0, 0.0)
        to.write_bytes(type(image)(found.astype(kind), image.affine, header).to_bytes())
        if suffix_of(path) == ".nii.gz":
            to.write_bytes(gzip.compress(to.read_bytes(), mtime=0))

    return (_matrices(values, _LOWER) if six else values), affine, stored, save


def _nrrd(path: Path, options: ReadOptions) -> Read:
    nrrd: Any = need("nrrd", "volumes")
    try:
        raw, header = nrrd.read(str(path))
    except (nrrd.NRRDError, OSError, EOFError, ValueError) as cause:
        raise volumes.broken(path, cause) from cause
    kinds = [str(kind) for kind in header.get("kinds") or ()]
    axes = [axis for axis, kind in enumerate(kinds) if kind in _AXES]
    if len(axes) != 1 or raw.ndim != 4:
        raise InputError(
            f"{path.name}: three axes of samples and one of components expected, whose kind is one of {', '.join(_AXES)}; got "
            f"axes of the kinds {', '.join(kinds) or '(none)'}, shape {raw.shape}"
        )
    (axis,), layout = axes, _AXES[kinds[axes[0]]]
    if (layout == "plain") != (options.kind == "vectors"):
        raise InputError(
            f"{path.name}: its components are those of a {kinds[axis]}, no {options.kind}; give the other kind"
        )
    moved = np.moveaxis(raw, axis, -1)
    mask = moved[..., 0] if layout == "masked" else None
    values = moved if layout == "plain" else _matrices(moved[..., -6:], _UPPER)
    if mask is not None:
        values = np.where((mask > 0)[..., None, None], values, np.nan)
    others = [i for i in range(4) if i != axis]
    if "space directions" in header:
        affine = np.asarray(header["space directions"], float)[others].T
    else:
        affine = np.diag(np.nan_to_num(np.asarray(header.get("spacings", np.ones(4)), float)[others], nan=1.0))

    def stored(components: Array) -> Array:
        """The samples of the file."""
        found = components if layout == "plain" else np.stack([components[..., i, j] for i, j in _UPPER], axis=-1)
        if mask is not None:
            found = np.where((mask > 0)[..., None], found, moved[..., 1:])
            found = np.concatenate([mask[..., None].astype(found.dtype), found], axis=-1)
        return np.moveaxis(found, -1, axis)

    def save(found: Array, to: Path) -> None:
        """Write them with the header of the file."""
        kept = {name: word for name, word in header.items() if name not in ("type", "endian", "sizes", "dimension")}
        kept.pop("data file", None)
        nrrd.write(str(to), found.astype(raw.dtype if raw.dtype.kind == "f" else found.dtype), kept)

    return values, affine, stored, save


def _matrices(six: Array, order: tuple[tuple[int, int], ...]) -> Array:
    """Matrices (..., 3, 3) of six components (..., 6)."""
    found = np.empty((*six.shape[:-1], 3, 3), six.dtype if six.dtype.kind == "f" else np.float64)
    for component, (i, j) in enumerate(order):
        found[..., i, j] = found[..., j, i] = six[..., component]
    return found
