"""What cannot be meant is refused by the door in words that lead to what can, never by an error of Python from within."""

import dataclasses
import inspect

import numpy as np
import pytest
import trimesh

import meshflow
from meshflow import Compute, FixedStep, HeightField, InputError, Mesh, Pinhole, SemiImplicit, smooth
from meshflow.geometry.options import named_fields

RANDOM = np.random.default_rng(14)
Z = np.sin(np.arange(40) / 5.0) + np.arange(36)[:, None] / 9.0 + RANDOM.normal(0, 0.05, (36, 40))
BALL = trimesh.creation.icosphere(2)
POINTS, FACES = np.array(BALL.vertices), np.array(BALL.faces)
CAMERA = Pinhole(50, 50, 20, 18)


def refused(call, words):
    with pytest.raises(InputError, match=words):
        call()


def test_whole_numbers_of_floating_point_are_faces():
    plain, faces = smooth((POINTS, FACES.astype(float)), time=0.01)
    np.testing.assert_array_equal(plain, smooth((POINTS, FACES), time=0.01)[0])
    assert faces.dtype == float
    assert Mesh(POINTS, FACES.astype(np.float32)).faces.dtype.kind == "i"


@pytest.mark.parametrize("make", [lambda faces: smooth((POINTS, faces)), lambda faces: Mesh(POINTS, faces)])
@pytest.mark.parametrize(
    ("faces", "words"),
    [
        (FACES + 0.5, r"faces: whole numbers expected, got \d+\.5 \(float64\)"),
        (FACES * np.nan, "faces: whole numbers expected, got nan"),
        (FACES > 2, "faces: whole numbers expected, got dtype bool"),
        (FACES.astype(str), "faces: whole numbers expected, got dtype <U"),
        (FACES.astype(object), "faces: whole numbers expected, got dtype object"),
        (FACES - 1, "faces: vertices 0 to 161 expected, got -1"),
        (FACES + 1, "got 162; they count from 1, as in an OBJ: give faces - 1"),
        (FACES + 2, "faces: vertices 0 to 161 expected, got 163$"),
    ],
)
def test_faces_that_are_no_vertices_are_refused(make, faces, words):
    refused(lambda: make(faces), words)


def test_points_and_faces_in_the_other_order_are_seen():
    refused(lambda: smooth((FACES, POINTS)), "are they swapped")


def test_points_in_the_plane_are_refused_where_nothing_would_move():
    flat = POINTS[:, :2]
    for method in (None, "quick", "curvature"):
        refused(lambda method=method: smooth((flat, FACES), method=method), r"shape \(n, 3\) expected, got \(162, 2\)")
    rim = np.array([(np.cos(t), np.sin(t)) for t in np.arange(12) * np.pi / 6] + [(0, 0)])
    fan = np.column_stack([np.arange(12), (np.arange(12) + 1) % 12, np.full(12, 12)])
    shrunk = smooth((rim, fan), method="curvature", time=0.02, boundary="neumann")[0]
    assert np.hypot(*shrunk[:12].T).max() < 0.95  # a border that is free moves
    smooth((flat, FACES), channels=POINTS[:, 2])  # values on it are


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Compute(stepper=SemiImplicit), r"got the class SemiImplicit; give SemiImplicit\(\)"),
        (lambda: Compute(control=FixedStep), r"give FixedStep\(\)"),
        (lambda: smooth(Z, compute=Compute), r"give Compute\(\)"),
        (lambda: smooth(Z, camera=Pinhole), r"give Pinhole\(\.\.\.\)"),
        (lambda: smooth(HeightField), r"give HeightField\(\.\.\.\)"),
        (lambda: smooth(Z, method=meshflow.PeronaMalik), r"give PeronaMalik\(\)"),
        (lambda: smooth(Z, stop=meshflow.Residual), r"give Residual\(\)"),
        (lambda: smooth(Z, constraints=[meshflow.Fixed]), r"give Fixed\(\.\.\.\)"),
    ],
)
def test_a_class_is_no_object_and_the_brackets_are_named(call, words):
    refused(call, words)


@pytest.mark.parametrize("size", [1e-200, 1e200])
@pytest.mark.parametrize("make", [lambda x: x, lambda x: (x, 1.0), lambda x: (1.0, x), lambda x: (np.full(36, x), 1.0)])
@pytest.mark.parametrize("data", [Z, np.dstack([Z, Z])])
def test_a_spacing_whose_powers_are_no_numbers_is_refused(data, make, size):
    refused(lambda: smooth(data, spacing=make(size)), "spacing")


PARTS = [one for one in (getattr(meshflow, name) for name in meshflow.__all__) if dataclasses.is_dataclass(one)]


@pytest.mark.parametrize("kind", PARTS, ids=lambda kind: kind.__name__)
def test_every_public_class_refuses_a_word_that_it_does_not_have_and_shows_those_that_it_has(kind):
    refused(lambda: kind(nothing_like_it=3), f"nothing_like_it: no such option of {kind.__name__}; there are")
    shown = list(inspect.signature(kind).parameters)
    assert shown == [field.name for field in dataclasses.fields(kind) if field.init and not field.kw_only] + [
        field.name for field in dataclasses.fields(kind) if field.init and field.kw_only
    ]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: meshflow.PeronaMalik(sharpnes=3), "sharpnes: no such option of PeronaMalik; did you mean sharpness"),
        (lambda: Compute(treads=2), "did you mean threads"),
        (lambda: HeightField(Z, unti="m"), "did you mean unit"),
        (lambda: meshflow.PeronaMalik(3), "options by name expected, got 3; there are contrast"),
        (lambda: meshflow.Residual(0.9, 3), r"Residual\(share\): at most 1 value expected, got 2"),
        (lambda: meshflow.Residual(0.9, share=0.8), "Residual: share is given twice"),
        (lambda: Pinhole(50, 50), r"a value expected for cx and cy, got nothing; give Pinhole\(fx, fy, cx, cy\)"),
        (lambda: meshflow.Fixed(), r"Fixed: a value expected for mask, got nothing; give Fixed\(mask\)"),
        (lambda: meshflow.Steps(), "Steps: a value expected for count"),
        (lambda: dataclasses.replace(meshflow.PeronaMalik(), sharpnes=3), "did you mean sharpness"),
    ],
)
def test_a_call_that_does_not_fit_a_class_is_refused_with_what_fits(call, words):
    refused(call, words)


def test_an_error_of_type_from_within_a_class_is_not_taken_for_a_wrong_call():
    @named_fields
    @dataclasses.dataclass
    class Part:
        """A part whose check fails."""

        value: int

        def __post_init__(self):
            self.value + "a"

    with pytest.raises(TypeError, match="unsupported operand"):
        Part(3)


UNDECLARED = np.where(np.arange(40) < 6, -9999.0, Z)


@pytest.mark.long
@pytest.mark.parametrize("how", [{"nodata": -9999}, {"missing": -9999}, {"missing": UNDECLARED == -9999}])
@pytest.mark.parametrize("data", [UNDECLARED, np.dstack([Z, UNDECLARED]), UNDECLARED.astype(np.float32)])
def test_what_the_warning_of_undeclared_samples_advises_is_taken_and_equals_a_mask(data, how):
    gone = UNDECLARED == -9999
    found = smooth(data, result=True, **how)
    np.testing.assert_array_equal(found.data, smooth(data, missing=gone))
    np.testing.assert_array_equal(found.data[gone], data[gone])
    assert found.before.missing.sum() == gone.sum()
    assert not found.warnings


@pytest.mark.parametrize("how", [{"nodata": -9999}, {"missing": -9999}])
def test_nodata_of_a_dataarray_is_missing(how):
    xarray = pytest.importorskip("xarray")
    array = xarray.DataArray(UNDECLARED, {"y": np.arange(36), "x": np.arange(40)})
    assert smooth(array, result=True, **how).before.missing.sum() == (UNDECLARED == -9999).sum()


def test_an_unknown_word_of_each_function_is_refused_with_the_words_of_that_function():
    refused(
        lambda: meshflow.estimate_noise(Z, methd=3),
        "methd: no keyword of estimate_noise; it takes metadata only: kind,",
    )
    refused(lambda: meshflow.estimate_noise(Z, spacin=3), "did you mean spacing")
    refused(lambda: smooth(Z, nothing_like_it=3), "nothing_like_it: no such keyword; there are method, time")


DEPTH = 2 + Z / 50
ALONG = ["search", "quick", "beltrami", "graph", "mean-curvature", "total-variation"]


@pytest.mark.parametrize(
    "word", ["perona-malik", "geman-mcclure", "heat", "patches", "shock", "rof", "curvature", "fairing"]
)
def test_a_method_that_is_not_defined_along_rays_is_refused_by_name_with_those_that_are(word):
    with pytest.raises(InputError) as told:
        smooth(DEPTH, camera=CAMERA, method=word)
    assert str(told.value).startswith(f"method={word!r}: ")
    listed = str(told.value).partition("methods for this data are ")[2].partition(";")[0]
    assert listed.split(", ") == ALONG
    if word not in ("curvature", "fairing"):
        assert "domain='disparity'" in str(told.value)
        smooth(DEPTH, camera=CAMERA, method=word, domain="disparity", time=1)


@pytest.mark.parametrize("word", ALONG)
def test_a_method_that_is_offered_along_rays_runs(word):
    smooth(DEPTH, camera=CAMERA, method=word, time=1)


def test_a_boundary_is_refused_with_the_nearest_one():
    refused(
        lambda: smooth(Z, boundary="neuman"),
        r"border-curve \(of meshes\) expected, got 'neuman'; did you mean neumann",
    )


@pytest.mark.parametrize(("word", "search"), [("search", False), ("quick", True)])
def test_a_method_and_a_search_that_contradict_each_other_are_refused(word, search):
    refused(lambda: smooth(Z, method=word, compute=Compute(search=search)), "contradict each other")
    smooth(Z, method=word, compute=Compute(search=not search))


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.uint16])
def test_depths_in_millimetres_are_metres_for_the_flow_and_millimetres_afterwards(dtype):
    stored = (DEPTH * 1000).astype(dtype)
    stored[3:5, 3:9] = 0
    found = smooth(stored, camera=CAMERA, depth_scale=1000, result=True)
    assert found.parameters["noise"].unit == "m"
    np.testing.assert_array_equal(found.data[3:5, 3:9], 0)
    metres = smooth(np.where(stored == 0, np.nan, stored / 1000.0), camera=CAMERA, missing=stored == 0)
    np.testing.assert_allclose(found.data[stored > 0], 1000 * metres[stored > 0], rtol=3e-6)


@pytest.mark.parametrize("how", [{"depth_scale": 1000}, {"measure": "range"}, {"jump": None}])
def test_an_option_of_depths_without_a_camera_is_refused_with_what_lacks(how):
    refused(lambda: smooth(DEPTH, **how), "of depths, which need their camera; give camera=")


@pytest.mark.parametrize(
    ("made", "plain"),
    [
        (lambda: smooth(Z, method="Perona_Malik"), lambda: smooth(Z, method="perona-malik")),
        (lambda: smooth(Z, method="PeronaMalik"), lambda: smooth(Z, method="perona-malik")),
        (lambda: smooth(Z, time=1, boundary="Neumann"), lambda: smooth(Z, time=1, boundary="neumann")),
        (lambda: smooth(Z, time=1, kind="Terrain"), lambda: smooth(Z, time=1)),
        (
            lambda: smooth(Z, time=1, compute=Compute(stepper="Semi_Implicit", diagonals="BOTH")),
            lambda: smooth(Z, time=1, compute=Compute(stepper="semi-implicit", diagonals="both")),
        ),
        (
            lambda: smooth(Z, time=1, method=meshflow.Beltrami(mass="Ring")),
            lambda: smooth(Z, time=1, method=meshflow.Beltrami(mass="ring")),
        ),
    ],
)
def test_a_word_is_taken_in_any_case_and_with_any_hyphen(made, plain):
    np.testing.assert_array_equal(made(), plain())


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda: smooth(Z, kind="dem"),
            "kind: terrain, image, depth, mesh, volume, tetrahedra, vectors or tensors expected, got 'dem'; did you mean terrain",
        ),
        (lambda: smooth(Z, method="tv"), "tv: no such method; use total-variation"),
        (lambda: smooth(Z, method="Gaussian"), "no such method; use heat"),
        (lambda: smooth(Z, method=""), "an empty word: no such method"),
        (lambda: meshflow.Beltrami(mass="rings"), "got 'rings'; did you mean ring"),
        (lambda: meshflow.Fairing(along="normal"), "did you mean normals"),
        (lambda: Compute(stepper="implicit"), "did you mean semi-implicit"),
        (lambda: smooth(Z, outliers="kep"), "did you mean keep"),
        (lambda: SemiImplicit(solver="directly"), "did you mean direct"),
    ],
)
def test_an_unknown_word_is_refused_with_the_nearest_one_and_with_those_that_there_are(call, words):
    refused(call, words)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: smooth(Z, constraints=Z > 0), r"got an array \(36, 40\); give Mask\(array\)"),
        (
            lambda: smooth(Z, noise=np.ones_like(Z)),
            r"noise: a positive finite number expected, got an array \(36, 40\)$",
        ),
        (lambda: smooth(Z, time=Z), r"got an array \(36, 40\)$"),
        (lambda: smooth(Z, stop=Z), r"got an array \(36, 40\)$"),
        (lambda: smooth(Z, level=Z), r"got an array \(36, 40\)$"),
        (lambda: smooth(Z, method=Z), r"got an array \(36, 40\)$"),
        (lambda: smooth(Z, noise="1.0"), "got the text '1.0'"),
        (lambda: smooth(Z, spacing=0), "spacing: a positive finite number expected, got 0"),
        (lambda: smooth(Z.astype(str)), "got dtype <U32; convert it first"),
        (lambda: smooth(Z * 1j), "take the real part"),
        (lambda: smooth((POINTS, FACES), channels="colors"), "channels: a number or an array expected, got 'colors'"),
        (lambda: smooth(np.stack([Z, Z, Z])), "looks like 3 channels that come first"),
        (lambda: smooth(None), "data: an array expected, got nothing"),
        (lambda: smooth(Z[0], camera=CAMERA), "an array of 2 dimensions expected, got shape"),
        (lambda: smooth(DEPTH, camera="kinnect"), "kinnect: no such camera; did you mean kinect"),
        (lambda: smooth(Z, method=meshflow.Beltrami(gamma=1e6)), "gamma: an exponent from -12 to 100"),
        (lambda: meshflow.Beltrami(gamma=-50), "steep places move too fast"),
        (lambda: meshflow.film(Z, "f.avi"), r"a film ends in .mp4, .gif; got .avi"),
        (lambda: meshflow.film(Z, "f.gif", frames=4), "frames: no such option of a film; did you mean count"),
    ],
)
def test_what_came_is_named_in_a_few_words_with_the_way_out(call, words):
    with pytest.raises(InputError, match=words) as told:
        call()
    assert len(str(told.value)) < 500


@pytest.mark.parametrize(
    "make",
    [
        lambda: meshflow.Steps(True),
        lambda: meshflow.Residual(True),
        lambda: meshflow.Beltrami(twicing=True),
        lambda: meshflow.Beltrami(gamma=False),
        lambda: Compute(threads=True),
        lambda: FixedStep(True),
        lambda: meshflow.MaxChange(True),
        lambda: meshflow.MinComponent(True),
        lambda: smooth(Z, noise=True),
        lambda: smooth(Z, strength=np.bool_(True)),
        lambda: HeightField(Z, spacing=True),
    ],
)
def test_a_truth_value_is_no_number(make):
    refused(make, "expected, got (np.)?(True|False)")


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: meshflow.MaxChange(-1), "max_change: a number, zero or more, or an array expected, got -1"),
        (lambda: meshflow.Mobility(2), "mobility: a number, zero to 1"),
        (lambda: meshflow.DataWeights(np.nan), "data_weights: a number, zero or more"),
        (lambda: meshflow.Fixed(None), "Fixed: a value expected, got nothing"),
        (lambda: smooth(Z, constraints=meshflow.MaxChange("stp")), "max_change: a number, 'step' or an array expected"),
    ],
)
def test_a_constraint_refuses_a_number_that_cannot_be_when_it_is_made(make, words):
    refused(make, words)


def test_none_is_what_is_not_given():
    np.testing.assert_array_equal(smooth(Z, stop=None, constraints=None, compute=None), smooth(Z))


def test_a_parameter_is_a_number_for_numpy_and_for_python_and_an_unknown_one_is_refused_with_the_nearest():
    found = smooth(Z, method="perona-malik", time=2.5, result=True).parameters
    time = found["time"]
    assert (np.sqrt(time), round(time), -time, abs(time), time**2) == (np.sqrt(2.5), 2, -2.5, 2.5, 6.25)
    assert np.array([time, time]).dtype == np.float64
    with pytest.raises(KeyError, match="contrst: no such parameter; did you mean contrast"):
        _ = found["contrst"]
    assert found.get("contrst") is None


@pytest.mark.parametrize(
    ("data", "name"),
    [
        (Z, "a.npy"),
        (np.dstack([Z, Z, Z]).astype(np.float32), "a.npy"),
        (Z.astype(np.float32), "a.tif"),
        (HeightField(Z), "a.npz"),
        ((POINTS, FACES), "a.ply"),
        (Mesh(POINTS, FACES), "a.obj"),
    ],
)
def test_an_array_or_a_data_object_is_written_and_read_again(data, name, tmp_path):
    meshflow.write(data, tmp_path / name)
    back = meshflow.read(tmp_path / name).data
    before = meshflow.smooth(data, time=0, result=True).before
    one, other = (
        x.points if isinstance(x, Mesh) else getattr(x, "z", getattr(x, "values", None)) for x in (back, before)
    )
    np.testing.assert_allclose(one, other, rtol=1e-7)
    refused(lambda: meshflow.write(BALL, tmp_path / "b.ply"), "objects of other libraries have their own writers")


@pytest.mark.parametrize("size", [1e4, 1e300])
def test_sizes_that_no_run_survives_are_refused_or_harmless(size):
    z = np.random.default_rng(0).normal(size=(20, 24))
    with pytest.raises(InputError, match="radius: 1 to 1000 samples expected"):
        meshflow.MinMax(radius=size)
    assert np.isfinite(meshflow.smooth(z, method=meshflow.ShockFilter(switch=size), time=1.0)).all()
