"""Turning, shifting, scaling, relabelling and permuting change nothing else."""

import numpy as np
from helpers import shapes
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from meshflow.flow.engines.mesh import MeshFlow
from meshflow.flow.family import Variant
from meshflow.surfaces.grid import Lift
from meshflow.surfaces.height_field import HeightField
from meshflow.surfaces.image import Image
from meshflow.surfaces.mesh import Mesh

heights = arrays(np.float64, st.tuples(st.integers(3, 7), st.integers(3, 7)), elements=st.floats(-4, 4, width=32))
variants = st.builds(
    Variant,
    gamma=st.sampled_from([-2.0, -1.0, 0.0, 1.0]),
    indicator=st.sampled_from(["metric", "projection"]),
    mass=st.sampled_from(["barycentric", "voronoi", "ring"]),
)
boundaries = st.sampled_from(["neumann", "plane-preserving", "fixed"])
quick = settings(max_examples=40, deadline=None)


def rate(data, variant, boundary, diagonals="both"):
    surface = data.lifted(Lift(diagonals=diagonals, boundary=boundary))
    return MeshFlow(surface, variant).rate(surface.start)


def same(a, b, tolerance=1e-9):
    # The projection indicator is a ratio of two small vectors where the surface is nearly flat: compare with the largest rate.
    assert np.abs(a - b).max() <= tolerance * max(np.abs(a).max(), np.abs(b).max(), 1e-6)


@quick
@given(heights, variants, boundaries)
def test_turning_a_height_field_by_90_degrees_turns_its_rate(z, variant, boundary):
    here = rate(HeightField(z), variant, boundary).reshape(z.shape)
    there = rate(HeightField(np.rot90(z)), variant, boundary).reshape(z.shape[::-1])
    same(np.rot90(here), there)


@quick
@given(heights, variants, boundaries, st.floats(-1000, 1000))
def test_shifting_the_heights_changes_nothing(z, variant, boundary, shift):
    same(rate(HeightField(z), variant, boundary), rate(HeightField(z + shift), variant, boundary), 1e-6)


@quick
@given(heights, variants, boundaries, st.floats(1e-3, 1e3))
def test_scaling_all_lengths_scales_the_rate_by_its_inverse(z, variant, boundary, scale):
    same(rate(HeightField(z), variant, boundary), scale * rate(HeightField(scale * z, scale), variant, boundary))


@quick
@given(
    arrays(np.float64, (5, 6, 3), elements=st.floats(-4, 4, width=32)), variants, boundaries, st.permutations(range(3))
)
def test_permuting_channels_permutes_the_rate(values, variant, boundary, order):
    here = rate(Image(values), variant, boundary)
    same(here[:, order], rate(Image(values[..., order]), variant, boundary))


@quick
@given(st.integers(0, 1000), boundaries)
def test_relabelling_the_vertices_relabels_the_rate(seed, boundary):
    rng = np.random.default_rng(seed)
    points, faces, _ = shapes.square(60, seed)
    points = points + rng.normal(size=points.shape) * 0.02
    order = rng.permutation(len(points))
    turned = np.argsort(order)[faces][rng.permutation(len(faces))]
    turned = np.take_along_axis(turned, (np.arange(3) + rng.integers(0, 3, (len(faces), 1))) % 3, axis=1)
    here = rate(Mesh(points, faces), Variant(), boundary)
    same(here[order], rate(Mesh(points[order], turned), Variant(), boundary))


@quick
@given(st.integers(0, 1000))
def test_rotating_a_mesh_rotates_its_rate(seed):
    rng = np.random.default_rng(seed)
    points, faces = shapes.sphere(60, seed)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    same(
        rate(Mesh(points, faces), Variant(), "neumann") @ turn.T,
        rate(Mesh(points @ turn.T + 5, faces), Variant(), "neumann"),
    )
