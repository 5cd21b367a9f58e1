"""Files and options at random: ``fuzz.py files|options FOLDER SECONDS SEED``; ends with a list of what is wrong.

What is tried lies in FOLDER before it is tried: of a process that ended it is what ended it.
"""

import json
import random
import signal
import sys
import time
import traceback
import zipfile
from pathlib import Path

import numpy as np

# Seconds that a file of some kilobytes, or a run on some hundred samples, may take.
PATIENCE = 30


def seeds(folder):
    """A file of each format that is read, and the options to read it with."""
    import pyvista
    import rasterio
    import trimesh
    from PIL import Image as Picture

    import meshflow
    from meshflow.io.files import read, write

    rng = np.random.default_rng(0)
    z = np.cumsum(rng.normal(size=(20, 24)), axis=1).astype(np.float32) + 100
    place = {"crs": "EPSG:4326", "transform": rasterio.Affine(0.001, 0, 7, 0, -0.001, 47)}
    shape = {"height": 20, "width": 24, "count": 1}
    for name, kind, more in (
        ("float.tif", z, place | {"nodata": -9999}),
        ("tiled.tif", z, {"compress": "deflate", "tiled": True, "blockxsize": 16, "blockysize": 16}),
        ("whole.tif", z.astype("i2"), {"compress": "lzw", "predictor": 2}),
    ):
        with rasterio.open(folder / name, "w", driver="GTiff", dtype=kind.dtype, **shape, **more) as target:
            target.write(kind, 1)
    for name in ("a.asc", "a.npy", "a.npz"):
        write(read(folder / "float.tif"), folder / name)
    grey = np.clip(z, 0, 255).astype(np.uint8)
    for suffix in (".png", ".jpg", ".bmp", ".webp"):
        Picture.fromarray(np.stack([grey] * 3, axis=2)).save(folder / f"a{suffix}")
    Picture.fromarray((z * 10).astype(np.uint16)).save(folder / "depth.png")
    (folder / "camera.json").write_text(json.dumps({"fx": 30, "fy": 30, "cx": 11.5, "cy": 9.5}))
    vrt = '<VRTDataset rasterXSize="24" rasterYSize="20"><VRTRasterBand dataType="Float32" band="1"><SimpleSource>'
    vrt += '<SourceFilename relativeToVRT="1">float.tif</SourceFilename><SourceBand>1</SourceBand></SimpleSource>'
    (folder / "a.vrt").write_text(vrt + "</VRTRasterBand></VRTDataset>")
    tile = (np.arange(1201 * 1201) % 500).astype(">i2").tobytes()
    with zipfile.ZipFile(folder / "N46E008.hgt.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("N46E008.hgt", tile)
    rows = np.stack([*np.meshgrid(np.arange(24.0), np.arange(20.0)), z], axis=-1).astype("<f4")
    header = "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 24\nHEIGHT 20\nPOINTS 480\nDATA "
    (folder / "a.pcd").write_bytes(f"{header}binary\n".encode() + rows.tobytes())
    (folder / "text.pcd").write_text(
        f"{header}ascii\n" + "\n".join(" ".join(map(str, p)) for p in rows.reshape(-1, 3).tolist()) + "\n"
    )
    ball = trimesh.creation.icosphere(subdivisions=1)
    ball.visual.vertex_colors = rng.integers(0, 255, (42, 4), dtype=np.uint8)
    for suffix in (".ply", ".obj", ".stl", ".off", ".glb"):
        ball.export(folder / f"a{suffix}")
    ball.export(folder / "text.ply", encoding="ascii")
    corners = np.column_stack([np.full(len(ball.faces), 3), ball.faces, np.zeros(len(ball.faces))]).astype(">i4")
    (folder / "binary.off").write_bytes(
        b"OFF BINARY\n"
        + np.array([42, 80, 0], ">i4").tobytes()
        + ball.vertices.astype(">f4").tobytes()
        + corners.tobytes()
    )
    ball.export(folder / "text.stl", file_type="stl_ascii")
    write(read(folder / "a.ply"), folder / "a.gltf")
    poly = pyvista.Icosphere(nsub=1)
    poly.point_data["a"] = rng.normal(size=42)
    for name, binary in (("a.vtp", True), ("text.vtp", False), ("a.vtk", True), ("text.vtk", False)):
        poly.save(folder / name, binary=binary)
    poly.cast_to_unstructured_grid().save(folder / "a.vtu")
    pyvista.MultiBlock({"one": poly, "two": poly}).save(folder / "a.vtm")
    scan = meshflow.RangeImage(z / 100, meshflow.Pinhole(30, 30, 11.5, 9.5))
    write(meshflow.io.document.Document(scan, folder / "x"), folder / "grid.ply")
    camera = folder / "camera.json"
    options = {"depth.png": {"camera": camera}, "camera.json": {}}
    return [(path, options.get(path.name, {})) for path in sorted(folder.iterdir()) if path.is_file()]


def mutated(content, dice):
    """The bytes of a file, cut off, changed, longer, or with a number that lies."""
    made = bytearray(content)
    for _ in range(dice.choice((1, 1, 2, 4))):
        at = dice.randrange(len(made))
        match dice.randrange(7):
            case 0:
                made = made[: max(1, at)]
            case 1:
                made[at] = dice.randrange(256)
            case 2:
                made[at] ^= 1 << dice.randrange(8)
            case 3:
                made[at : at + 4] = dice.choice((b"\xff\xff\xff\xff", b"\0\0\0\0", b"\xff\xff\xff\x7f", b"\0\0\0\x80"))
            case 4:
                made[at:at] = made[at : at + dice.randrange(1, 64)]
            case 5:
                digits = [i for i, byte in enumerate(made[:4000]) if 48 <= byte <= 57]
                where = dice.choice(digits) if digits else at
                made[where : where + 1] = dice.choice(
                    (b"-1", b"4000000000", b"nan", b"1e400", b"", b"99999", b"x", b"0")
                )
            case 6:
                del made[at : at + dice.randrange(1, 16)]
        if not made:
            return b"\0"
    return bytes(made)


def refusal(call):
    """What is wrong with how a call ends: nothing, where it succeeds or is refused in one line."""
    from meshflow.errors import InputError, MissingPackage, NotConverged

    signal.alarm(PATIENCE)
    try:
        call()
    except (InputError, MissingPackage, NotConverged) as cause:
        return "" if str(cause).strip() and "\n" not in str(cause) else f"more than a line: {cause!r}"
    except TimeoutError:
        return f"longer than {PATIENCE} s"
    except Exception:  # noqa: BLE001 - whatever it is, it is what is looked for
        return traceback.format_exc()
    finally:
        signal.alarm(0)
    return ""


def files(folder, end, dice):
    """Read mutated files until the time is over."""
    from meshflow.io.files import read
    from meshflow.io.formats.cameras import read_camera

    found, trial = [], 0
    ground = folder / "seeds"
    ground.mkdir()
    started = seeds(ground)
    while time.monotonic() < end:
        path, options = started[trial % len(started)]
        made = ground / f"trial{path.suffix}" if path.name != "N46E008.hgt.zip" else ground / "trial.hgt.zip"
        made.write_bytes(mutated(path.read_bytes(), dice))
        (folder / "now.txt").write_text(f"{trial} {path.name} {made}")
        reads = read_camera if path.suffix == ".json" else read
        wrong = refusal(lambda made=made, options=options, reads=reads: reads(made, **options))
        if wrong:
            kept = folder / f"wrong_{trial}{made.name.removeprefix('trial')}"
            kept.write_bytes(made.read_bytes())
            found.append(f"{kept} ({path.name}): {wrong}")
        trial += 1
    print(f"{trial} files")
    return found


def values(kind, dice):
    """A word for an option of this type."""
    import typing

    for part in (kind, *typing.get_args(kind)):
        if typing.get_origin(part) is typing.Literal:
            return dice.choice([*map(str, typing.get_args(part)), "nonsense"])
    if bool in (kind, *typing.get_args(kind)):
        return None
    numbers = ("0", "1", "2", "0.5", "-1", "1e-300", "1e300", "nan", "inf", "3", "10", "7", "1e9", "x", "")
    return dice.choice(numbers)


def options(folder, end, dice):
    """Smooth small data with options at random until the time is over."""
    import trimesh
    import typer
    from typer.testing import CliRunner

    from meshflow.cli.commands import UsageError, app
    from meshflow.cli.flags import FLOW
    from meshflow.cli.options import ALL
    from meshflow.errors import InputError, MissingPackage, NotConverged

    del typer
    rng = np.random.default_rng(1)
    np.save(folder / "a.npy", np.cumsum(rng.normal(size=(16, 18)), axis=1).astype(np.float32))
    np.save(folder / "c.npy", rng.normal(size=(12, 12, 3)).astype(np.float32))
    trimesh.creation.icosphere(subdivisions=2).export(folder / "m.ply")
    more = (
        "kind",
        "spacing",
        "nodata",
        "band",
        "channels",
        "moves",
        "time_unit",
        "measure",
        "depth_scale",
        "dtype",
        "verbose",
    )
    known = (*FLOW, *(flag for flag in ALL if flag.name in more))
    found, trial = [], 0
    allowed = (InputError, MissingPackage, NotConverged, UsageError, OSError, MemoryError, SystemExit)
    while time.monotonic() < end:
        source = dice.choice(("a.npy", "c.npy", "m.ply"))
        target = folder / f"out{Path(source).suffix}"
        words = ["smooth", str(folder / source), str(target), "--overwrite", "--quiet", "--threads", "1"]
        for flag in dice.sample(known, dice.choice((1, 2, 2, 3, 5))):
            word, given = (
                (flag.words or (f"--{flag.name.replace('_', '-')}",))[0].split("/")[0],
                values(flag.kind, dice),
            )
            words += [word] if given is None or flag.kind is bool else [f"{word}={given}"]
        if "--steps" not in " ".join(words):
            words += ["--steps=3"]
        (folder / "now.txt").write_text(" ".join(words))
        signal.alarm(PATIENCE)
        done = CliRunner().invoke(app, words)
        signal.alarm(0)
        if done.exception is not None and not isinstance(done.exception, allowed):
            told = "".join(traceback.format_exception(done.exception))
            found.append(f"{' '.join(words)}: {told}")
        elif isinstance(done.exception, InputError) and "\n" in str(done.exception):
            found.append(f"{' '.join(words)}: more than a line: {done.exception}")
        trial += 1
    print(f"{trial} sets of options")
    return found


def main():
    what, folder, seconds, seed = sys.argv[1], Path(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4])

    def late(number, frame):
        raise TimeoutError

    signal.signal(signal.SIGALRM, late)
    work = {"files": files, "options": options}[what]
    found = work(folder, time.monotonic() + seconds, random.Random(seed))
    print("\n\n".join(found))
    sys.exit(1 if found else 0)


if __name__ == "__main__":
    main()
