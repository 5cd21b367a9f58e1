"""What others do with a range image, each a plain function with the parameters over which it is searched.

Every ``run(z, sigma, **parameters)`` takes depths (h, w), NaN where missing, and the standard deviation of their noise at the
median depth, and returns depths, NaN where missing. What is called a multiple is one of sigma. A filter that takes any picture is
searched in both domains, of depths and of disparities 1 / z, in which the noise of triangulation is the same near and far. The
packages are imported where they are used.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from meshflow.errors import need
from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.steppers import SemiImplicit
from meshflow.geometry.validation import Array
from meshflow.surfaces.free import Axes
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.range_image import RangeImage
from meshflow.surfaces.visibility import Sight
from peers.search import Peer

__all__ = ["SpaceFlow", "bilateral", "laplacian", "meshlab", "range_peers", "realsense", "total_variation"]

DOMAINS = ("depth", "disparity")
# Depths and disparities of the 16 bits of a RealSense, its disparities in 1/32 pixels.
MOST, PARTS = 65000, 32.0
# The focal length that a camera is said to have, pixels; its rays do not enter the filter.
FOCAL = 500.0
# The largest edge threshold that its spatial filter takes, and the one that its disparities are scaled to.
THRESHOLD, SCALED = 50, 20


def _through(filtered: Callable[[Array, float], Array], z: Array, sigma: float, domain: str) -> Array:
    """A filter (values, their sigma) of depths, or of 1 / z; missing pixels stay missing."""
    if domain == "depth":
        return np.where(np.isfinite(z), filtered(z, sigma), np.nan)
    found = filtered(1.0 / z, sigma / float(np.nanmedian(z)) ** 2)
    there = np.isfinite(z) & (found > 0)
    return np.divide(1.0, found, out=np.full(z.shape, np.nan), where=there)


def _filled(z: Array) -> Array:
    """Missing pixels with the value of the nearest that is there."""
    from scipy.ndimage import distance_transform_edt

    _, (row, column) = distance_transform_edt(~np.isfinite(z), return_indices=True)  # pyright: ignore[reportGeneralTypeIssues]
    return z[row, column]


def bilateral(z: Array, sigma: float, colour: float, space: float, domain: str) -> Array:
    """Tomasi and Manduchi 1998: OpenCV. ``colour`` is a multiple, ``space`` in pixels.

    The filter has no mask. Holes are left at zero, so far from all depths that they weigh nothing: as good as one.
    """
    smooth = need("cv2", "bench").bilateralFilter

    def one(values: Array, noise: float) -> Array:
        whole = (np.nan_to_num(values) / noise).astype(np.float32)
        return smooth(whole, -1, colour, space).astype(np.float64) * noise

    return _through(one, z, sigma, domain)


def total_variation(z: Array, sigma: float, weight: float, iterations: float, domain: str) -> Array:
    """Rudin, Osher and Fatemi 1992, by Chambolle's iteration: skimage. ``weight`` is a multiple.

    It has no mask: holes are filled by the nearest pixel first, and are holes again after. Fewer ``iterations`` than it takes to
    converge leave less of a staircase, so that their number is searched, too.
    """
    denoise = need("skimage.restoration", "bench").denoise_tv_chambolle

    def one(values: Array, noise: float) -> Array:
        whole = (_filled(values) / noise).astype(np.float32)
        return denoise(whole, weight=weight, eps=1e-9, max_num_iter=int(iterations)).astype(np.float64) * noise

    return _through(one, z, sigma, domain)


def realsense(z: Array, sigma: float, threshold: float, alpha: float, magnitude: float, domain: str) -> Array:
    """The domain transform (Gastal and Oliveira 2011) of Intel's depth cameras, holes kept: pyrealsense2, without a camera.

    A camera's unit of depth and baseline are what they are; here each is such that the threshold is one that the filter takes
    (its numbers are whole, 1 to 50), and that rounding to whole units costs nothing.

    :param threshold: a multiple, the difference of neighbours that is an edge.
    :param alpha: weight of the pixel itself, 0.25 to 1.
    :param magnitude: passes, 1 to 5.
    """
    rs = need("pyrealsense2", "bench")
    depth = np.nan_to_num(z)
    edge = threshold * sigma
    unit, baseline, scale = max(edge / THRESHOLD, depth.max() / MOST), 50.0, 0.0
    if domain == "disparity":
        unit = depth.max() / MOST
        # Baseline in mm, focal length in pixels: disparity is scale / z, and its threshold SCALED at the median depth.
        scale = SCALED * float(np.nanmedian(z)) ** 2 / edge
        baseline = scale / (PARTS * FOCAL / 1000.0)
    device = rs.software_device()
    sensor, profile, queue = _started(rs, device, (unit, baseline), z.shape)
    try:
        frame = rs.software_video_frame()
        frame.pixels = np.rint(depth / unit).astype(np.uint16)
        frame.stride, frame.bpp, frame.depth_units = 2 * z.shape[1], 2, unit
        frame.timestamp, frame.frame_number, frame.profile = 0.0, 0, profile.as_video_stream_profile()
        sensor.on_video_frame(frame)
        taken = queue.wait_for_frame()
        # A filter keeps the threshold of its first frame, whatever it is told later: a new one each time.
        smooth = rs.spatial_filter()
        for option, value in (
            (rs.option.filter_magnitude, magnitude),
            (rs.option.filter_smooth_alpha, alpha),
            (rs.option.filter_smooth_delta, SCALED if domain == "disparity" else min(THRESHOLD, round(edge / unit))),
            (rs.option.holes_fill, 0),
        ):
            smooth.set_option(option, value)
        if domain == "disparity":
            out = smooth.process(rs.disparity_transform(True).process(taken))
            disparity = np.array(out.get_data()).view(np.float32).astype(np.float64)
            return np.divide(scale, disparity, out=np.full(z.shape, np.nan), where=np.isfinite(z) & (disparity > 0))
        found = np.array(smooth.process(taken).get_data()).astype(np.float64) * unit
        return np.where(np.isfinite(z) & (found > 0), found, np.nan)
    finally:
        sensor.stop()
        sensor.close()


def _started(rs: Any, device: Any, reported: tuple[float, float], shape: tuple[int, ...]) -> tuple[Any, Any, Any]:
    """Sensor, profile and queue of a depth stream (h, w) of a camera that there is not, of this unit and baseline."""
    h, w = shape
    sensor = device.add_sensor("Depth")
    lens = rs.intrinsics()
    lens.width, lens.height, lens.fx, lens.fy = w, h, FOCAL, FOCAL
    lens.ppx, lens.ppy, lens.model = (w - 1) / 2, (h - 1) / 2, rs.distortion.none
    stream = rs.video_stream()
    stream.type, stream.index, stream.uid, stream.fmt = rs.stream.depth, 0, 1, rs.format.z16
    stream.width, stream.height, stream.fps, stream.bpp, stream.intrinsics = w, h, 30, 2, lens
    profile = sensor.add_video_stream(stream)
    sensor.add_read_only_option(rs.option.depth_units, reported[0])
    sensor.add_read_only_option(rs.option.stereo_baseline, reported[1])
    queue = rs.frame_queue(1)
    sensor.open(profile)
    sensor.start(queue)
    return sensor, profile, queue


def meshlab(z: Array, sigma: float, camera: Any, steps: float, delta: float, jump: str) -> Array:
    """MeshLab's depth smoothing, Laplacian steps along the lines of sight: pymeshlab.

    :param steps: how many.
    :param delta: the share of each that is taken, percent.
    :param jump: the share of the nearer depth beyond which neighbours are not joined.
    """
    ml = need("pymeshlab", "bench")
    points, faces = _triangulated(z, camera, float(jump))
    used, corners = np.unique(faces, return_inverse=True)
    session = ml.MeshSet()
    session.add_mesh(ml.Mesh(points[used], corners.reshape(-1, 3)))
    session.apply_coord_depth_smoothing(
        stepsmoothnum=int(steps), viewpoint=np.zeros(3), delta=ml.PercentageValue(delta)
    )
    # No vertex leaves its line of sight (5e-16 m on a room), so that its depth is that of its pixel.
    found = z.copy().ravel()
    found[used] *= session.current_mesh().vertex_matrix()[:, 2] / points[used, 2]
    return found.reshape(z.shape)


def laplacian(z: Array, sigma: float, camera: Any, steps: float, weight: str, jump: str) -> Array:
    """Laplacian smoothing of the triangulated image, all of R^3 free, seen again by the camera: pymeshlab.

    :param steps: how many.
    :param weight: ``uniform`` or ``cotangent``.
    :param jump: as that of :func:`meshlab`.
    """
    ml = need("pymeshlab", "bench")
    points, faces = _triangulated(z, camera, float(jump))
    used, corners = np.unique(faces, return_inverse=True)
    session = ml.MeshSet()
    session.add_mesh(ml.Mesh(points[used], corners.reshape(-1, 3)))
    session.apply_coord_laplacian_smoothing(
        stepsmoothnum=int(steps), boundary=True, cotangentweight=weight == "cotangent"
    )
    moved = points.copy()
    moved[used] = session.current_mesh().vertex_matrix()
    return _seen(Sight.through(camera, (z.shape[0], z.shape[1])), z, moved, faces)


def _seen(sight: Sight, z: Array, points: Array, faces: Array) -> Array:
    """The depths of a moved surface; pixels without a triangle keep theirs, those that the surface has left have none."""
    alone = np.ones(z.size, bool)
    alone[faces.ravel()] = False
    found = sight.rendered(np.nan_to_num(points), faces)
    return np.where(np.isfinite(z), np.where(alone.reshape(z.shape), z, found), np.nan)


def _triangulated(z: Array, camera: Any, jump: float) -> tuple[Array, Array]:
    """Points (h * w, 3) and triangles of a range image."""
    surface = RangeImage(z, camera, jump=jump).lifted(Lift(diagonals="forward"))
    return surface.points, surface.triangulations[0]


@dataclass(eq=False)
class SpaceFlow:
    """Mean curvature flow of the triangulated image, all of R^3 free, seen again by the camera: ours, with semi-implicit steps.

    Time is in squared pixel footprints of the start. Pixels without a triangle stay as they are; those that the surface has left
    are missing. What is asked once is kept, since each time begins where the one before ended.

    :param camera: what :class:`RangeImage` takes.
    :param times: ascending; others are not asked.
    :param dt: the longest step.
    """

    camera: Any
    times: tuple[float, ...]
    dt: float = 1.0
    kept: dict[tuple[bytes, str], list[Array]] = field(default_factory=dict, repr=False)

    def __call__(self, z: Array, sigma: float, time: float, jump: str) -> Array:
        """The depths at a time."""
        image = RangeImage(z, self.camera, jump=float(jump))
        grid = image.gridded(Lift(boundary="plane-preserving"))
        surface = grid.surface()
        faces = image.lifted(Lift(diagonals="forward")).triangulations[0]
        points = self.kept.setdefault((z.tobytes(), jump), [])
        flow = MeshFlow(replace(surface, free=Axes((0, 1, 2))))
        ends = (0.0, *self.times)
        while len(points) <= self.times.index(time):
            k = len(points)
            u = points[-1] if points else surface.points
            count = int(np.ceil((ends[k + 1] - ends[k]) / self.dt))
            for turn in range(count):
                u = SemiImplicit(tolerance=1e-4).step(flow, u, (ends[k + 1] - ends[k]) / count, turn)
            points.append(u)
        assert grid.lines is not None
        return _seen(Sight.along(grid.lines, grid.shape), z, points[self.times.index(time)], faces)


def range_peers(camera: Any) -> tuple[Peer, ...]:
    """The peers of a camera, and the ranges in which each is searched."""
    times = (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 13.0)
    steps = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64, 100, 150)

    def depth_smoothing(z: Array, sigma: float, **choice: Any) -> Array:
        return meshlab(z, sigma, camera, **choice)

    def space_smoothing(z: Array, sigma: float, **choice: Any) -> Array:
        return laplacian(z, sigma, camera, **choice)

    return (
        Peer(
            "bilateral (OpenCV)",
            "opencv-contrib-python-headless",
            bilateral,
            {
                "colour": (1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 40.0),
                "space": (1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0),
                "domain": DOMAINS,
            },
        ),
        Peer(
            "TV (skimage)",
            "scikit-image",
            total_variation,
            {
                "weight": (0.25, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0, 2.8, 4.0, 5.6, 8.0, 11.0, 16.0),
                "iterations": (5, 10, 20, 40, 80, 160, 320),
                "domain": DOMAINS,
            },
        ),
        Peer(
            "domain transform (librealsense)",
            "pyrealsense2",
            realsense,
            {
                "threshold": (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 20.0),
                "alpha": (0.25, 0.32, 0.4, 0.5, 0.6, 0.7, 0.8),
                "magnitude": (1, 2, 3, 5),
                "domain": DOMAINS,
            },
            frozenset({("alpha", 0.25), ("magnitude", 1), ("magnitude", 5)}),
        ),
        Peer(
            "depth smoothing (MeshLab)",
            "pymeshlab",
            depth_smoothing,
            {"steps": steps, "delta": (25.0, 50.0, 75.0, 100.0), "jump": ("0.02", "0.05")},
            frozenset({("steps", 1), ("delta", 100.0)}),
        ),
        Peer(
            "3D Laplacian (MeshLab)",
            "pymeshlab",
            space_smoothing,
            {"steps": steps[:10], "weight": ("uniform", "cotangent"), "jump": ("0.05",)},
            frozenset({("steps", 1)}),
        ),
        Peer("3D curvature flow", "meshflow", SpaceFlow(camera, times), {"time": times, "jump": ("0.05",)}),
    )
