"""What `pyproject.toml` promises of old packages: print its lower bounds as pins, or try the library on what is installed.

``python .ci/oldest.py pins`` prints one requirement per line. ``python .ci/oldest.py try`` smooths one of each kind of data.
"""

import re
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

EXTRAS = ("xarray",)  # that a call for a kind of data needs


def pins() -> list[str]:
    """Every requirement at its lower bound.

    :raises SystemExit: for a requirement without one.
    """
    project = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text())["project"]
    wanted = [*project["dependencies"], *(name for extra in EXTRAS for name in project["optional-dependencies"][extra])]
    loose = [name for name in wanted if not re.fullmatch(r"[\w.-]+(\[[\w,-]+\])?>=[\d.]+", name)]
    if loose:
        raise SystemExit(f"pyproject.toml: a lower bound (>=) expected, got {', '.join(loose)}")
    return [name.replace(">=", "==") for name in wanted]


def attempt() -> None:
    """One call for each kind of data, each of which takes out noise; and one file by the command."""
    import numpy as np
    import xarray

    import meshflow

    rng = np.random.default_rng(0)
    noise = rng.normal(size=(48, 64))
    slope = 0.5 * np.arange(64.0) + np.zeros((48, 1))

    def rms(values: object) -> float:
        return float(np.sqrt(np.mean(np.square(values))))

    heights = meshflow.smooth(slope + noise, spacing=1.0)
    assert rms(heights - slope) < 0.6, "a height field keeps its noise"
    labelled = meshflow.smooth(xarray.DataArray(slope + noise, dims=("y", "x")), spacing=1.0)
    assert isinstance(labelled, xarray.DataArray)
    assert np.array_equal(labelled.values, heights), "a DataArray is not smoothed as its array is"

    grey = np.clip(np.repeat(128 + 10 * noise[..., None], 3, axis=2), 0, 255).astype(np.uint8)
    image = meshflow.smooth(grey)
    assert rms(image - 128.0) < 8, "an image keeps its noise"

    depth = 2.0 + 0.01 * noise
    camera = meshflow.Pinhole(fx=60, fy=60, cx=31.5, cy=23.5)
    found = meshflow.smooth(depth, camera=camera)
    assert rms(found - 2.0) < 0.006, "a range image keeps its noise"

    import trimesh

    ball = trimesh.creation.icosphere(4)
    rough = ball.copy()
    rough.vertices = ball.vertices + 0.01 * rng.normal(size=ball.vertices.shape)
    smoothed = meshflow.smooth(rough)
    assert isinstance(smoothed, trimesh.Trimesh)
    radius = np.linalg.norm(smoothed.vertices, axis=1)
    assert radius.std() < 0.7 * np.linalg.norm(rough.vertices, axis=1).std(), "a mesh keeps its noise"

    with tempfile.TemporaryDirectory() as folder:
        source, target, picture = (Path(folder) / name for name in ("in.ply", "out.ply", "out.png"))
        rough.export(source)
        for words in (["smooth", source, target, "-q"], ["info", target]):
            subprocess.run([sys.executable, "-m", "meshflow", *map(str, words)], check=True, stdout=subprocess.DEVNULL)
        assert len(trimesh.load(target, process=False).vertices) == len(rough.vertices)
        meshflow.view.compare(slope + noise, heights, picture, renderer="hillshade")
        assert picture.stat().st_size > 10_000
    print("every kind of data works on", sys.version.split()[0], "with numpy", np.__version__)


if __name__ == "__main__":
    print("\n".join(pins())) if sys.argv[1:] == ["pins"] else attempt()
