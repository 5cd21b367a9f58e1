"""Each example runs, is short, and ends in a number that holds."""

import importlib.util
import sys
from pathlib import Path

import pytest
from matplotlib.image import imread

EXAMPLES = Path(__file__).parents[1] / "examples"


def example(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(EXAMPLES))  # as for a script
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(EXAMPLES))
    return module


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.py")), ids=lambda p: p.stem)
def test_an_example_is_shorter_than_sixty_lines(path):
    assert path.read_text().count("\n") < 60


def drawn(path):
    """Whether a picture is there, and not blank."""
    picture = imread(path)
    return picture.shape[1] == 1400 and (picture[..., :3] < 0.9).any(axis=2).mean() > 0.1


def test_a_range_scan_smoothed_along_its_rays_has_a_third_of_its_error():
    assert 0 < example("smooth_range_scan").main() < 1 / 3


@pytest.mark.needs_gl
def test_figure_1_terraces_of_quantisation_go_and_the_truth_comes_nearer(tmp_path):
    assert 0.1 < example("paper_1_terrain").main(tmp_path / "a.png") < 0.7
    assert drawn(tmp_path / "a.png")


@pytest.mark.long
@pytest.mark.needs_gl
def test_figure_3_cotangents_leave_vertices_where_uniform_weights_drag_them(tmp_path):
    assert 0 < example("paper_3_irregular_sampling").main(tmp_path / "a.png") < 0.3
    assert drawn(tmp_path / "a.png")


@pytest.mark.needs_gl
def test_figure_6_the_curvature_of_an_unevenly_sampled_sphere_is_one(tmp_path):
    assert 0 < example("paper_6_curvature").main(tmp_path / "a.png") < 0.025
    assert drawn(tmp_path / "a.png")


@pytest.mark.long
def test_figure_7_discs_come_out_of_noise_in_grey_and_in_colour(tmp_path):
    assert 0 < example("paper_7_synthetic").main(tmp_path / "a.png") < 0.25
    assert drawn(tmp_path / "a.png")


@pytest.mark.long
def test_figure_8_super_time_takes_a_sixth_of_the_rates_to_the_same_picture(tmp_path):
    rates, away = example("paper_8_colour").main(tmp_path / "a.png")
    assert rates < 60  # instead of 300
    assert away < 0.5
    assert drawn(tmp_path / "a.png")


@pytest.mark.needs_gl
def test_figure_10_the_clock_is_an_image_and_a_height_field(tmp_path):
    assert 0 < example("paper_10_clock").main(tmp_path / "a.png") < 0.35
    assert drawn(tmp_path / "a.png")


@pytest.mark.long
@pytest.mark.needs_gl
def test_figure_9_a_head_comes_out_of_noisy_depths(tmp_path):
    pytest.importorskip("pymeshlab")
    assert 0 < example("paper_9_head").main(tmp_path / "a.png") < 0.4
    assert drawn(tmp_path / "a.png")


@pytest.mark.long
def test_a_scene_of_four_decades_fits_on_a_screen_of_two_with_its_details(tmp_path):
    assert example("tone_mapping").main(tmp_path / "a.png") > 50
    assert drawn(tmp_path / "a.png")


@pytest.mark.long
@pytest.mark.needs_gl
def test_stripes_follow_the_flow_past_a_cylinder(tmp_path):
    module = example("flow_past_cylinder")
    if not module.FIELD.exists():
        pytest.skip("../shared/data/fields/cylinder_Re35 is not there")
    assert module.main(tmp_path / "a.png", finer=2) > 5
    assert drawn(tmp_path / "a.png")


@pytest.mark.long
def test_heights_that_move_alone_end_nearer_the_truth_than_points_that_move_in_space(tmp_path):
    space, heights = example("compare_3d_and_graph_flow").main(tmp_path / "a.png")
    assert drawn(tmp_path / "a.png")
    assert heights < 0.95 * space < 1.0


@pytest.mark.long
def test_of_four_flows_equally_smooth_the_ray_flow_alone_leaves_silhouettes_where_they_are(tmp_path):
    rays, others, normals = example("compare_flows").main(tmp_path / "flows.png")
    assert rays < 1e-9
    assert others > 0.1
    assert 0 < normals < 0.15
    assert (tmp_path / "flows.png").stat().st_size > 50_000


@pytest.mark.long
@pytest.mark.needs_gl
def test_a_terrain_is_written_and_pictured_before_and_after(tmp_path):
    removed = example("view_before_after").main(tmp_path)
    assert 1.0 < removed < 2.2  # the noise that went in is 2 m
    assert (tmp_path / "smoothed.tif").stat().st_size > 100_000
    assert (tmp_path / "before_after.png").stat().st_size > 50_000
