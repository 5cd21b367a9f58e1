"""``smooth``: takes any supported data and returns the same kind of data. The command calls it, too."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeVar, Unpack, overload

from meshflow.errors import InputError, attention, warn
from meshflow.estimate.constraints import Constraint
from meshflow.estimate.noise import Noise
from meshflow.estimate.noise_growth import noise_growth
from meshflow.estimate.planner import noise_in
from meshflow.estimate.preparation import OutlierWord
from meshflow.estimate.request import BoundaryWord, Domain, Request, Stopping
from meshflow.estimate.stripes import Level
from meshflow.flow.compute import Compute
from meshflow.flow.methods import Method
from meshflow.flow.progress import Progress
from meshflow.geometry.validation import must_be_truth
from meshflow.io.adapters.multipart import multipart
from meshflow.io.document import Document
from meshflow.io.metadata import Metadata, ReadOptions
from meshflow.io.objects import Imported, from_object, opened, taken_in
from meshflow.large.chunks import is_chunked, smooth_chunked
from meshflow.large.outcome import Outcome
from meshflow.large.stacks import Slices, is_stack, smooth_stack
from meshflow.results.domains import run_in_domain
from meshflow.results.keywords import must_be_keywords, must_be_metadata
from meshflow.results.multipart import Results, every_warning, one_by_one
from meshflow.results.result import Result
from meshflow.surfaces.range_image import RangeImage

__all__ = ["Metadata", "estimate_noise", "noise_facts", "smooth", "smooth_lazily", "smooth_object"]

Data = TypeVar("Data")


@overload
def smooth(
    data: Data,
    *,
    method: Method | str | None = None,
    time: float | None = None,
    scale: float | None = None,
    strength: float = 1.0,
    noise: float | None = None,
    stop: Stopping | Iterable[Stopping] | None = (),
    constraints: Constraint | Iterable[Constraint] | None = (),
    boundary: BoundaryWord | None = None,
    domain: Domain = "auto",
    outliers: OutlierWord | None = None,
    level: Level | None = None,
    compute: Compute | None = Compute(),  # noqa: B008 - frozen
    progress: Progress = None,
    result: Literal[False] = False,
    **metadata: Unpack[Metadata],
) -> Data: ...
@overload
def smooth(
    data: Any,
    *,
    method: Method | str | None = None,
    time: float | None = None,
    scale: float | None = None,
    strength: float = 1.0,
    noise: float | None = None,
    stop: Stopping | Iterable[Stopping] | None = (),
    constraints: Constraint | Iterable[Constraint] | None = (),
    boundary: BoundaryWord | None = None,
    domain: Domain = "auto",
    outliers: OutlierWord | None = None,
    level: Level | None = None,
    compute: Compute | None = Compute(),  # noqa: B008 - frozen
    progress: Progress = None,
    result: Literal[True],
    **metadata: Unpack[Metadata],
) -> Result: ...


def smooth(
    data: Any,
    *,
    method: Method | str | None = None,
    time: float | None = None,
    scale: float | None = None,
    strength: float = 1.0,
    noise: float | None = None,
    stop: Stopping | Iterable[Stopping] | None = (),
    constraints: Constraint | Iterable[Constraint] | None = (),
    boundary: BoundaryWord | None = None,
    domain: Domain = "auto",
    outliers: OutlierWord | None = None,
    level: Level | None = None,
    compute: Compute | None = Compute(),  # noqa: B008 - frozen
    progress: Progress = None,
    result: bool = False,
    **metadata: Unpack[Metadata],
) -> Any:
    """Smooth data and keep its edges; the result is a new object of the same kind.

    By default the noise is estimated, and the method and time with the smallest estimated error are chosen; for range images
    the time follows from the noise. There are many keywords because all kinds of data are taken; each checks itself.

    Example:

        >>> import numpy as np
        >>> from meshflow.synthetic import mesas, noisy
        >>> truth = mesas(64)  # (h, w), metres
        >>> z = smooth(noisy(truth, 2.0), spacing=1.0)
        >>> bool(np.std(z - truth) < 1.2)
        True
        >>> result = smooth(noisy(truth, 2.0), spacing=1.0, result=True)
        >>> round(result.noise.sigma)
        2

    :param data: a numpy array of shape (h, w), a height field, or (h, w, k), an image of k channels; with ``kind="volume"``
        (d, h, w), a volume; NaN and masked samples are missing. ``(points, faces)`` is a mesh. Also ``trimesh.Trimesh``;
        ``pyvista`` PolyData, ImageData, StructuredGrid, RectilinearGrid and UnstructuredGrid; ``open3d`` meshes and depth images;
        ``meshio.Mesh``; pictures of Pillow; arrays of ``xarray``, and of ``dask``, which come back lazy; ``trimesh.Scene`` and
        ``pyvista.MultiBlock``, smoothed part by part; a data object of meshflow; a document; a path.
    :param method: a method such as ``PeronaMalik(sharpness=2)``, or its name, which stands for the class with its defaults.
        ``"quick"`` is one fixed choice for all data. None: a method is searched for.
    :param time: how long the flow runs, squared length; or ``scale``, of the equal Gaussian on flat data: time = scale² / 2.
    :param strength: a factor on the noise; above 1 more is removed, below 1 less.
    :param noise: the standard deviation of the noise, in the unit of the values. None: it is estimated.
    :param stop: ``Steps``, ``Residual``, ``AreaLoss``, ``Displacement``, a callable (values, time), or several of them.
    :param constraints: ``Fixed``, ``Mask``, ``MaxChange``, ``DataWeights``, ``Mobility``, ``PreserveVolume``,
        ``PreserveArea``, ``MinComponent``, or several of them. Their arrays hold one number per sample, as the data stores
        its samples, or are the name of an array that the data holds.
    :param boundary: the condition at borders and holes: ``plane-preserving | neumann | fixed``, for meshes also ``border-curve``.
    :param domain: ``length``; of range images ``disparity``: inverse depths are smoothed; of colours ``luv``, ``lab`` or
        ``linear-rgb``: they are smoothed there. The parameters refer to it; ``noise``, and ``MaxChange`` of depths, do not.
    :param outliers: samples of grids, values of points and vertices that are not of the data (nodata, impulses, spikes): ``keep``
        (left out), ``repair`` (from neighbours) or ``include``. None: repair single ones of images and vectors, else keep.
    :param level: ``rows`` or ``columns`` of a grid that are shifted against each other.
    :param compute: stepper, threads, triangulation.
    :param progress: None, True (a bar on stderr) or a callable ``(done, total)``.
    :param result: return a :class:`Result` (:class:`Results` of parts, :class:`Outcome` of lazy data); else warnings are issued.
    :param metadata: what the data does not say: ``kind`` (``terrain | image | depth | mesh | volume | vectors | tensors``);
        ``spacing``, ``missing``, ``nodata`` of grids; ``unit`` of heights and depths; ``camera``, ``depth_scale``, ``measure``,
        ``jump``, ``time_unit`` of depths; ``channels``, ``moves`` of meshes; ``channels``, ``max_edge`` of tables of points.
    :returns: the same kind of data, smoothed. Integers are returned as floating point, because rounding would undo the smoothing.
    :raises InputError: for data that cannot be smoothed, or an option that does not exist; the message says what to do.
    :raises NotConverged: when a solver fails.
    """
    must_be_keywords(metadata, tuple(smooth.__kwdefaults__ or {}), method)
    must_be_truth(result, "result")
    asked = Request.of(
        method, stop, constraints, time=time, scale=scale, strength=strength, noise=noise, boundary=boundary, domain=domain,
        outliers=outliers, level=level, compute=compute or Compute())  # fmt: skip
    return _answered(data, asked, progress, result, metadata)


def _answered(data: Any, asked: Request, progress: Progress, result: bool, metadata: Mapping[str, Any]) -> Any:
    """The result, or the data that it holds; the warnings of the latter are issued."""
    if is_stack(data, ReadOptions.of(metadata)) or is_chunked(data):
        back, found = smooth_lazily(data, asked, metadata)
        said = found.warnings
    else:
        back, found = smooth_object(data, asked, progress, record=result or None, metadata=metadata)
        said = every_warning(found)
    warn(() if result else said)
    return found if result else back


def smooth_lazily(
    data: Any, request: Request, metadata: Mapping[str, Any], *, measure: bool = False
) -> tuple[Any, Slices | Outcome]:
    """:func:`smooth` of an array of dask, a DataArray that holds one, or a stack of slices, for a request object.

    :param measure: whether what is removed is measured while all is computed, in this process; ``computed()`` of the result then
        has it.
    :returns: the same kind of data, and what is known before it is computed.
    :raises InputError: as :func:`smooth`.
    """
    options = ReadOptions.of(metadata)
    if is_stack(data, options):
        return smooth_stack(data, request, options, _Slice({**metadata, "slices": None}, measure), measure=measure)
    return smooth_chunked(data, request, options, measure=measure)


@dataclass(frozen=True)
class _Slice:
    """Smooths a slice of a stack by itself.

    :ivar measure: of :func:`smooth_lazily`.
    """

    metadata: Mapping[str, Any]
    measure: bool = False

    def __call__(self, data: Any, request: Request) -> tuple[Any, Result | Outcome]:
        """The smoothed slice, and its result."""
        if is_chunked(data):
            return smooth_chunked(data, request, ReadOptions.of(self.metadata), measure=self.measure)
        back, found = smooth_object(data, request, record=None, metadata=self.metadata)
        if not isinstance(found, Result):
            raise InputError("slices: one part expected in each slice, got several")
        return back, found


def smooth_object(
    data: Any,
    request: Request,
    progress: Progress = None,
    *,
    record: bool | None = True,
    metadata: Mapping[str, Any] | None = None,
) -> tuple[Any, Result | Results]:
    """:func:`smooth` for a request object; returns the smoothed data and the result.

    :param record: True: measure the surface after each step. False: the history holds the start and the end. None: it is empty.
    """
    data, options = opened(data, ReadOptions.of(metadata or {}))
    parts = multipart(data, options)
    if parts is not None:
        results = one_by_one(parts, request.constraints, lambda part: _smoothed(part, request, progress, record))
        if isinstance(data, Document):
            results = replace(results, warnings=(*attention(data.notes), *results.warnings))
        return results.data, results
    imported = taken_in(data, options)
    found = _smoothed(imported, request, progress, record)
    back = imported.to_object(found.after)
    worth = attention(imported.notes)
    notes = tuple(note for note in imported.notes if note not in worth)
    return back, replace(found, data=back, notes=notes, warnings=(*worth, *found.warnings))


def _smoothed(imported: Imported, request: Request, progress: Progress, record: bool | None) -> Result:
    """Smooth an imported object; the arrays of the constraints are brought into the order of its samples."""
    request = replace(request, constraints=request.constraints.sampled(imported.samples))
    return run_in_domain(imported.data, request, progress, record=record)


def estimate_noise(data: Any, **metadata: Unpack[Metadata]) -> Noise:
    """Estimate the noise of data as :func:`smooth` does: on grids in the unit of the values, on meshes along the normals.

    Example:

        >>> from meshflow.synthetic import fractal_terrain, noisy
        >>> noise = estimate_noise(noisy(fractal_terrain(64), 3.0))
        >>> round(noise.sigma)
        3

    :param data: as in :func:`smooth`.
    :param metadata: as in :func:`smooth`.
    :returns: the standard deviation ``sigma``, the standard deviation of each channel, the correlation between samples and
        between channels, offsets of rows and columns, and the quantum of rounded data; ``sentences()`` says it in words.
    :raises InputError: for data that cannot be smoothed.
    """
    must_be_metadata(metadata, "estimate_noise")
    imported = from_object(data, metadata)
    warn(imported.notes)
    return noise_in(imported.data)


def noise_facts(data: Any) -> dict[str, float]:
    """The estimated noise of a data object by name, in the unit of its values.

    For depths also the coefficients of its growth, sigma = a + b z + c z^2.
    """
    found = noise_in(data)
    facts = {"noise": found.sigma, "quantum": found.quantum}
    if found.quantum > 0:
        facts["on the quantum"] = found.share
    if len(found.channels) > 1:
        facts |= {f"noise of channel {i}": sigma for i, sigma in enumerate(found.channels)}
    if found.correlation is not None:
        facts |= {"noise length, rows (samples)": found.lengths[0], "noise length, columns (samples)": found.lengths[1]}
    lines = found.lines
    facts |= {
        f"offsets of {name}": size for name, size in (("rows", lines.rows), ("columns", lines.columns)) if size > 0
    }
    if isinstance(data, RangeImage):
        growth = noise_growth(data.depth, data.missing)
        if growth is not None:
            facts |= {"noise a": growth.a, "noise b (per depth)": growth.b, "noise c (per depth²)": growth.c}
    return facts
