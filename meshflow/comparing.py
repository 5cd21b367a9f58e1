"""``compare_methods``: several methods side by side on the same data, at equal noise removed."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike

from meshflow.errors import InputError
from meshflow.flow.compute import Compute
from meshflow.flow.methods import Method, method_of
from meshflow.flow.stops import Residual
from meshflow.geometry.options import named_fields
from meshflow.geometry.validation import Array, positive
from meshflow.io.metadata import Metadata
from meshflow.io.objects import from_object
from meshflow.results.result import Result
from meshflow.smoothing import smooth
from meshflow.surfaces.data import array_of
from meshflow.surfaces.mesh import Mesh

__all__ = ["MethodRun", "compare_methods"]


@named_fields
@dataclass(frozen=True, eq=False)
class MethodRun:
    """A method on the data of a comparison.

    :ivar name: of the method.
    :ivar removed: root mean square of what was removed, over the noise; of points that move, of the distance that they moved.
    :ivar error: root mean square error against the truth, unit of the values, or the distance of points; None without a truth.
    :ivar largest: the largest change of a value, or of a point.
    :ivar time: of the flow, squared length; ``steps``: their number; ``seconds``: the whole call.
    :ivar result: of the run.
    """

    name: str
    removed: float
    error: float | None
    largest: float
    time: float
    steps: int
    seconds: float
    result: Result = field(repr=False)

    def as_dict(self) -> dict[str, str | float | int | None]:
        """The numbers by name."""
        names = ("name", "removed", "error", "largest", "time", "steps", "seconds")
        return {name: getattr(self, name) for name in names}


def compare_methods(
    data: Any,
    methods: Iterable[Method | str] | Method | str,
    truth: ArrayLike | None = None,
    *,
    noise: float | None = None,
    removed: float = 0.9,
    picture: str | Path | None = None,
    overwrite: bool = False,
    **metadata: Unpack[Metadata],
) -> tuple[MethodRun, ...]:
    """Run methods on the same data until each has removed the same amount, and compare them; with a truth, the best comes
    first.

    Each runs until the root mean square of what it removed is ``removed`` times the noise, with its contrast by rule. A method
    that does not get there (a scheme that stops; restorations at rest, whose noise is multiplied instead) is measured where
    it ends; ``removed`` of the run says so. It has more than six parameters because those of the picture belong to it.

    Example:

        >>> from meshflow.synthetic import mesas, noisy
        >>> truth = mesas(48)
        >>> runs = compare_methods(noisy(truth, 2.0), ["heat", "perona-malik"], truth, spacing=1.0)
        >>> [run.name for run in runs]  # the least error first
        ['perona-malik', 'heat']

    :param data: as in :func:`meshflow.smooth`; not of several parts.
    :param methods: names, or methods with options; a single one may be given alone.
    :param truth: values of the shape of the data; points (n, d) of a mesh.
    :param noise: as in :func:`meshflow.smooth`.
    :param removed: share of the noise, above 0, at most 1.
    :param picture: a picture to write (.png, .jpg, .tif): the data, each result, what each removed, and a table.
    :param overwrite: replace an existing picture.
    :param metadata: what the data does not say of itself (``spacing``, ``kind``, ...), as in :func:`meshflow.smooth`.
    :raises InputError: for no method, a truth of another shape, or where :func:`meshflow.smooth` refuses.
    """
    if not isinstance(methods, Iterable):
        methods = (methods,)
    asked = [method_of(one) for one in ((methods,) if isinstance(methods, str) else methods)]
    if not asked:
        raise InputError("methods: one or more expected, got none")
    if positive(removed, "removed") > 1:
        raise InputError(f"removed: a share of the noise up to 1 expected, got {removed}")
    before = array_of(from_object(data, metadata).data)
    true = None if truth is None else np.asarray(truth, dtype=np.float64)
    if true is not None and true.shape != before.shape:
        raise InputError(f"truth: the shape of the data, {before.shape}, expected, got {true.shape}")
    if picture is not None:
        from meshflow.view.pictures import writable

        writable(picture, overwrite=overwrite)
    runs = [_run(data, one, before, true, (noise, removed), metadata) for one in asked]
    runs = sorted(runs, key=lambda run: run.error or 0.0)
    if picture is not None:
        _draw(runs, Path(picture), overwrite)
    return tuple(runs)


def _draw(runs: Sequence[MethodRun], picture: Path, overwrite: bool) -> None:
    """The runs side by side."""
    from meshflow.view.side_by_side import Column, side_by_side

    columns = []
    for run in runs:
        error = {} if run.error is None else {"rms error": f"{run.error:.4g}"}
        numbers = {
            "removed / noise": f"{run.removed:.2f}", **error, "largest change": f"{run.largest:.4g}",
            "time": f"{run.time:.4g}", "steps": str(run.steps), "seconds": f"{run.seconds:.2f}",
        }  # fmt: skip
        note = f"removed {run.removed:.2f} of the noise" + (f", error {run.error:.3g}" if run.error is not None else "")
        columns.append(Column(run.name, note, run.result.after, numbers))
    side_by_side(runs[0].result.before, columns, picture, overwrite=overwrite)


def _run(
    data: Any, method: Method, before: Array, truth: Array | None, asked: tuple[float | None, float], metadata: Metadata
) -> MethodRun:
    """One method.

    :param asked: the noise or None, and the share of it to be removed.
    """
    (noise, removed), began = asked, perf_counter()
    once = bool(getattr(method, "fits_noise", False))
    result: Result = smooth(
        data, method=method, noise=noise, stop=() if once else Residual(removed), strength=removed if once else 1.0,
        compute=Compute(search=False), result=True, **metadata,
    )  # fmt: skip
    seconds, after = perf_counter() - began, array_of(result.after)
    there = np.isfinite(before) & np.isfinite(after)
    points = isinstance(result.after, Mesh) and result.after.moves == "points"
    change, sigma = _sizes(after - before, there, points), float(result.parameters["noise"].value)
    error = None
    if truth is not None:
        error = float(np.sqrt(np.mean(np.square(_sizes(after - truth, there & np.isfinite(truth), points)))))
    share = float(np.sqrt(np.mean(np.square(change)))) / sigma if sigma > 0 else 0.0
    largest = float(change.max(initial=0.0))
    return MethodRun(method.word, share, error, largest, result.end.time, result.end.step, seconds, result)


def _sizes(change: Array, known: Array, points: bool) -> Array:
    """The sizes of changes, of each value (n,) that is known, or of each point (n, d)."""
    return np.linalg.norm(change[known.all(axis=-1)], axis=-1) if points else np.abs(change[known])
