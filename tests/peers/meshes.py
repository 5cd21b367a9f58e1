"""What others do with a mesh, each a plain function with the parameters over which it is searched.

Every ``run(points, faces, **parameters)`` takes points (n, 3) and faces (m, 3) and returns points (n, 3), the same vertices in
the same order. The packages are imported where they are used. MeshLib is free for non-commercial use only: no extra of meshflow
brings it, and it is asked where a user has installed it.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from meshflow import classics
from meshflow.errors import MissingPackage, need
from meshflow.geometry.validation import Array
from peers.normal_filters import bilateral_normals, guided_normals
from peers.search import Peer, Value

__all__ = ["OnFaces", "mesh_peers"]

# All frequencies of the umbrella are below this one.
WHOLE = 2.0


@dataclass(frozen=True, eq=False)
class OnFaces:
    """A function of points and faces as the search asks for it: of values and their noise.

    :ivar kept: of a function whose rounds begin where those before have ended: points by the choice and the number of rounds.
    """

    run: Callable[..., Array]
    faces: Array
    kept: dict[Any, dict[int, Array]] = field(default_factory=dict)

    def __call__(self, points: Array, sigma: float, **choice: Any) -> Array:
        """The points (n, 3) smoothed; nobody asks for the noise."""
        if self.run not in _BY_ROUNDS:
            return self.run(points, self.faces, **choice)
        rounds = int(choice.pop("rounds"))
        found = self.kept.setdefault((points.tobytes(), *sorted(choice.items())), {0: points})
        begun = max(one for one in found if one <= rounds)
        if begun < rounds:
            found[rounds] = self.run(found[begun], self.faces, rounds=rounds - begun, **choice)
        return found[rounds]


def umbrella(points: Array, faces: Array, weight: float, steps: float) -> Array:
    """[Field 88], [Taubin 95]: ours, plain; see :func:`classics.umbrella`."""
    return classics.umbrella(points, faces, weight, int(steps))


def scale_dependent(points: Array, faces: Array, time: float, steps: float) -> Array:
    """[DMSB99] section 4.2, implicit: ours; see :func:`classics.scale_dependent`."""
    return classics.scale_dependent(points, faces, time, int(steps))


def taubin(points: Array, faces: Array, weight: float, passband: float, steps: float) -> Array:
    """[Taubin 95]: ours, plain; see :func:`classics.taubin`."""
    return classics.taubin(points, faces, weight, passband, int(steps))


def hc(points: Array, faces: Array, alpha: float, beta: float, steps: float) -> Array:
    """[Vollmer 99]: ours, plain; see :func:`classics.hc`."""
    return classics.hc(points, faces, alpha, beta, int(steps))


def _vtk(points: Array, faces: Array) -> Any:
    import pyvista

    return pyvista.PolyData.from_regular_faces(np.asarray(points, dtype=np.float64), np.asarray(faces))


def windowed_sinc(points: Array, faces: Array, band: float, steps: float) -> Array:
    """Taubin, Zhang and Golub 1996, a windowed sinc of the umbrella: VTK.

    :param band: frequencies of the umbrella (0 to 2) that pass.
    :param steps: degree of the polynomial.
    """
    found = _vtk(points, faces).smooth_taubin(n_iter=int(steps), pass_band=band, normalize_coordinates=True)
    return np.array(found.points)


def vtk_smooth(points: Array, faces: Array, weight: float, steps: float) -> Array:
    """Laplacian smoothing, each vertex seeing those already moved: VTK."""
    return np.array(_vtk(points, faces).smooth(n_iter=int(steps), relaxation_factor=weight).points)


def features_after_sinc(
    points: Array,
    faces: Array,
    band: float,
    feature: float,
    bend: float,
    weight: float,
    steps: float,
    then: str,
) -> Array:
    """:func:`windowed_sinc` of degree 20, then what smooths features along themselves alone: VTK.

    On noise as it comes every edge is a feature, or none; after a first smoothing the angles tell them apart.

    :param band: of the first; at 2 there is none.
    :param feature: angle between normals, degrees, from which an edge is a feature.
    :param bend: of a feature, degrees, from which a vertex on it stays.
    :param weight: of a step, or, of a windowed sinc, a tenth of it the frequencies that pass.
    :param steps: how many, or the degree.
    :param then: ``laplacian | sinc``.
    """
    mesh = _vtk(points, faces)
    if band < WHOLE:
        mesh = mesh.smooth_taubin(n_iter=20, pass_band=band, normalize_coordinates=True)
    angles = {"edge_angle": bend, "feature_angle": feature, "feature_smoothing": True}
    if then == "sinc":
        found = mesh.smooth_taubin(n_iter=int(steps), pass_band=0.1 * weight, normalize_coordinates=True, **angles)
    else:
        found = mesh.smooth(n_iter=int(steps), relaxation_factor=weight, **angles)
    return np.array(found.points)


def _meshlab(points: Array, faces: Array, words: Iterable[tuple[str, Mapping[str, Any]]]) -> Array:
    """Filters of MeshLab, one after the other."""
    ml = need("pymeshlab", "bench")
    session = ml.MeshSet()
    session.add_mesh(ml.Mesh(points, faces))
    for name, options in words:
        getattr(session, f"apply_coord_{name}")(**options)
    return session.current_mesh().vertex_matrix()


def two_steps(points: Array, faces: Array, rounds: float, angle: float, normals: float, fits: float) -> Array:
    """Belyaev and Ohtake's two steps, normals first and vertices to fit them: MeshLab.

    :param rounds: of both.
    :param angle: between neighbouring normals, degrees, up to which they are averaged.
    :param normals: steps of smoothing the normals.
    :param fits: steps of fitting the vertices.
    """
    options = {"stepsmoothnum": int(rounds), "normalthr": angle, "stepnormalnum": int(normals), "stepfitnum": int(fits)}
    return _meshlab(points, faces, [("two_steps_smoothing", options)])


def meshlab_laplacian(points: Array, faces: Array, steps: float, weights: str) -> Array:
    """Laplacian smoothing with uniform or cotangent weights [DMSB99]: MeshLab."""
    options = {"stepsmoothnum": int(steps), "cotangentweight": weights == "cotangent"}
    return _meshlab(points, faces, [("laplacian_smoothing", options)])


def meshlab_taubin(points: Array, faces: Array, weight: float, passband: float, steps: float) -> Array:
    """[Taubin 95]: MeshLab."""
    options = {"lambda_": weight, "mu": classics.mu(weight, passband), "stepsmoothnum": int(steps)}
    return _meshlab(points, faces, [("taubin_smoothing", options)])


def meshlab_hc(points: Array, faces: Array, steps: float) -> Array:
    """[Vollmer 99] with MeshLab's own weights, which are not told: MeshLab."""
    return _meshlab(points, faces, [("hc_laplacian_smoothing", {})] * int(steps))


def meshlab_scale_dependent(points: Array, faces: Array, delta: float, steps: float) -> Array:
    """[DMSB99] section 4.2, explicit: MeshLab. ``delta`` in percent of the diagonal of the box around the mesh."""
    ml = need("pymeshlab", "bench")
    options = {"stepsmoothnum": int(steps), "delta": ml.PercentageValue(delta)}
    return _meshlab(points, faces, [("laplacian_smoothing_scale_dependent", options)])


def _open3d(points: Array, faces: Array, smoothed: Callable[[Any], Any]) -> Array:
    o3d = need("open3d", "scan")
    vectors = o3d.utility.Vector3dVector(points), o3d.utility.Vector3iVector(np.asarray(faces, dtype=np.int32))
    return np.array(smoothed(o3d.geometry.TriangleMesh(*vectors)).vertices)


def open3d_laplacian(points: Array, faces: Array, weight: float, steps: float) -> Array:
    """Laplacian smoothing, neighbours weighted by inverse distance: Open3D."""
    return _open3d(points, faces, lambda mesh: mesh.filter_smooth_laplacian(int(steps), weight))


def open3d_taubin(points: Array, faces: Array, weight: float, passband: float, steps: float) -> Array:
    """[Taubin 95], neighbours weighted by inverse distance: Open3D."""
    return _open3d(
        points, faces, lambda mesh: mesh.filter_smooth_taubin(int(steps), weight, classics.mu(weight, passband))
    )


def trimesh_taubin(points: Array, faces: Array, weight: float, passband: float, steps: float) -> Array:
    """[Taubin 95]: trimesh. On closed meshes :func:`taubin`; borders depend on the order of the triangles: not searched."""
    import trimesh

    mesh = trimesh.Trimesh(points, faces, process=False)
    trimesh.smoothing.filter_taubin(mesh, weight, -classics.mu(weight, passband), 2 * int(steps))
    return np.array(mesh.vertices)


def _meshlib(points: Array, faces: Array) -> tuple[Any, Any, Any]:
    """MeshLib, its bridge to numpy, and a mesh of it (float32)."""
    try:
        from meshlib import mrmeshnumpy, mrmeshpy  # pyright: ignore[reportMissingImports]
    except ImportError as cause:
        raise MissingPackage(
            f"meshlib is needed here ({cause}). It is free for non-commercial use only; where that suits: pip install meshlib"
        ) from cause
    corners: Any = np.asarray(faces, dtype=np.int32)
    vertices: Any = np.asarray(points, dtype=np.float32)
    mesh = mrmeshnumpy.meshFromFacesVerts(corners, vertices)
    return mrmeshpy, mrmeshnumpy, mesh


def meshlib_relax(points: Array, faces: Array, force: float, steps: float, volume: str) -> Array:
    """Laplacian smoothing, uniform weights: MeshLib. ``volume``: ``free``, or ``kept`` by pushing neighbours back."""
    ml, bridge, mesh = _meshlib(points, faces)
    params = ml.MeshRelaxParams()
    params.force, params.iterations = force, int(steps)
    (ml.relaxKeepVolume if volume == "kept" else ml.relax)(mesh, params)
    return np.array(bridge.getNumpyVerts(mesh), dtype=np.float64)[: len(points)]


def meshlib_denoise(
    points: Array,
    faces: Array,
    rounds: float,
    beta: float,
    gamma: float,
    normals: float,
    fits: float,
    guide: float,
) -> Array:
    """Mesh denoising via a Mumford-Shah framework (smoothed normals, vertices to fit them): MeshLib.

    :param rounds: of all of it, each from where the one before ended.
    :param beta: its sharpness of features, the less the sharper.
    :param gamma: how much smoothing.
    :param normals: steps of smoothing the normals.
    :param fits: steps of fitting the vertices.
    :param guide: how much a vertex keeps to where it was.
    """
    ml, bridge, mesh = _meshlib(points, faces)
    settings = ml.DenoiseViaNormalsSettings()
    settings.beta, settings.gamma, settings.guideWeight = beta, gamma, guide
    settings.normalIters, settings.pointIters = int(normals), int(fits)
    for _ in range(int(rounds)):
        ml.meshDenoiseViaNormals(mesh, settings)
    return np.array(bridge.getNumpyVerts(mesh), dtype=np.float64)[: len(points)]


def mesh_peers(faces: Array) -> tuple[Peer, ...]:
    """The peers on triangles (m, 3), and the ranges in which each is searched."""
    return tuple(
        Peer(name, package, OnFaces(run, faces), grid, ends, channels=False)
        for name, package, run, grid, ends in _PEERS
    )


# Functions whose rounds begin where those before have ended.
_BY_ROUNDS = (two_steps, guided_normals, meshlib_denoise)
_Grid = Mapping[str, tuple[Value, ...]]
_STEPS = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 140, 200, 300)
_BAND = (0.0005, 0.001, 0.003, 0.005, 0.01, 0.02, 0.03, 0.05, 0.07, 0.1, 0.15, 0.2, 0.3, 0.5, 0.7)
_PAIR: _Grid = {"weight": (0.2, 0.33, 0.5, 0.7, 1.0), "passband": _BAND, "steps": _STEPS}
_SINC: _Grid = {"band": _BAND, "steps": (5, 10, 20, 40, 80, 160)}
_LAPLACE: _Grid = {"weight": (0.05, 0.1, 0.2, 0.35, 0.5, 0.7, 1.0), "steps": _STEPS}
_FEATURES: _Grid = {
    "band": (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, WHOLE),
    "feature": (20.0, 25.0, 30.0, 35.0, 40.0, 45.0, 50.0, 60.0, 75.0, 90.0, 110.0),
    "bend": (30.0, 60.0, 120.0),
    "weight": (0.1, 0.3, 0.6, 0.9),
    "steps": (10, 20, 40, 80, 160, 300, 600, 1000),
    "then": ("laplacian", "sinc"),
}
_HC: _Grid = {
    "alpha": (0.0, 0.05, 0.1, 0.2, 0.4),
    "beta": (0.05, 0.1, 0.2, 0.4, 0.5, 0.6, 0.8, 0.9),
    "steps": _STEPS,
}
_ONE: frozenset[tuple[str, Value]] = frozenset({("steps", 1), ("weight", 1.0)})
_PEERS: tuple[tuple[str, str, Callable[..., Array], _Grid, frozenset[tuple[str, Value]]], ...] = (
    ("umbrella", "meshflow", umbrella, _LAPLACE, _ONE),
    (
        "scale-dependent umbrella",
        "meshflow",
        scale_dependent,
        {"time": (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 16.0), "steps": (1, 2, 4, 8)},
        _ONE,
    ),
    ("Taubin", "meshflow", taubin, _PAIR, _ONE),
    ("HC", "meshflow", hc, _HC, _ONE | {("alpha", 0.0)}),
    ("VTK windowed sinc", "vtk", windowed_sinc, _SINC, frozenset()),
    ("VTK smooth", "vtk", vtk_smooth, _LAPLACE, _ONE),
    ("VTK features after sinc", "vtk", features_after_sinc, _FEATURES, frozenset({("band", WHOLE)})),
    (
        "MeshLab two-step",
        "pymeshlab",
        two_steps,
        {
            "rounds": (1, 2, 4, 8, 16, 32, 64, 100, 150),
            "angle": (10.0, 15.0, 20.0, 30.0, 37.0, 45.0, 52.0, 60.0, 75.0, 90.0, 120.0),
            "normals": (1, 2, 5, 10, 20),
            "fits": (1, 2, 5, 10, 20),
        },
        frozenset({("rounds", 1), ("normals", 1), ("fits", 1)}),
    ),
    (
        "bilateral normals",
        "meshflow",
        bilateral_normals,
        {"width": (0.2, 0.3, 0.4, 0.55, 0.75, 1.0), "rounds": (2, 5, 10, 20, 40, 80, 160), "fits": (10, 20, 40, 80)},
        frozenset({("rounds", 2), ("fits", 10)}),
    ),
    (
        "guided normals",
        "meshflow",
        guided_normals,
        {"width": (0.1, 0.2, 0.3, 0.4, 0.5, 0.6), "rounds": (1, 2, 4, 8, 16, 32), "normal_rounds": (2, 5, 10, 20)},
        frozenset({("rounds", 1), ("normal_rounds", 2)}),
    ),
    (
        "MeshLab Laplacian",
        "pymeshlab",
        meshlab_laplacian,
        {"steps": _STEPS[:10], "weights": ("uniform", "cotangent")},
        _ONE,
    ),
    (
        "MeshLab scale-dependent",
        "pymeshlab",
        meshlab_scale_dependent,
        {"delta": (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0), "steps": _STEPS},
        _ONE,
    ),
    ("MeshLab Taubin", "pymeshlab", meshlab_taubin, _PAIR, _ONE),
    ("MeshLab HC", "pymeshlab", meshlab_hc, {"steps": _STEPS[:9]}, _ONE),
    ("Open3D Laplacian", "open3d", open3d_laplacian, _LAPLACE, _ONE),
    ("Open3D Taubin", "open3d", open3d_taubin, _PAIR, _ONE),
    (
        "MeshLib relax",
        "meshlib",
        meshlib_relax,
        {"force": (0.05, 0.1, 0.2, 0.3, 0.4, 0.5), "steps": _STEPS, "volume": ("free", "kept")},
        _ONE | {("force", 0.5)},
    ),
    (
        "MeshLib denoise",
        "meshlib",
        meshlib_denoise,
        {
            "rounds": (1, 2, 4, 8, 16),
            "beta": (0.0025, 0.005, 0.01, 0.02),
            "gamma": (3.0, 5.0, 10.0, 15.0, 20.0, 30.0),
            "normals": (5, 10),
            "fits": (20, 40),
            "guide": (0.3, 1.0, 3.0),
        },
        frozenset({("rounds", 1)}),
    ),
)
