"""Small mesh files made by hand, and what every test of mesh files does with them."""

from dataclasses import replace

import numpy as np
import trimesh
from PIL import Image as Picture

from meshflow.io.files import read, write


def moved(document, by=0.01):
    return document.holding(replace(document.data, points=document.data.points + np.float32(by)))


def again(path, target, by=0.01, **options):
    """Read, move, write; the document and the notes of the writer."""
    document = read(path, **options)
    return document, write(moved(document, by), target, tags={})


def whole(path, file_type=None):
    """The one mesh of a file, as trimesh reads it with every vertex where it was."""
    (mesh,) = trimesh.load_scene(path, file_type=file_type, process=False).geometry.values()
    return mesh


def ply(path, *, kind="ascii", before=(), vertex=("float x", "float y", "float z"), rows=None, faces=None, extra=()):
    """A PLY of a tetrahedron, ASCII."""
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
    rows = rows or [" ".join(map(str, corner)) for corner in corners]
    faces = faces or ["3 0 2 1", "3 0 1 3", "3 1 2 3", "3 2 0 3"]
    head = [
        "ply",
        f"format {kind} 1.0",
        "comment made by hand",
        *[line for line, _ in before],
        f"element vertex {len(rows)}",
        *[f"property {line}" for line in vertex],
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        *[line for line, _ in extra],
        "end_header",
    ]
    path.write_text("\n".join([*head, *[row for _, row in before], *rows, *faces, *[row for _, row in extra]]) + "\n")
    return path


def cube_obj(folder):
    """A cube of quads with texture, one material, groups and hard normals; its texture lies beside it."""
    folder.mkdir(exist_ok=True)
    Picture.fromarray(np.arange(192, dtype=np.uint8).reshape(8, 8, 3)).save(folder / "the image.png")
    (folder / "cube.mtl").write_text("newmtl wood\nKd 1 1 1\nmap_Kd the image.png\n")
    v = [f"v {x} {y} {z}" for x in (0, 1) for y in (0, 1) for z in (0, 1)]
    vt = ["vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
    vn = ["vn -1 0 0", "vn 1 0 0", "vn 0 -1 0", "vn 0 1 0", "vn 0 0 -1", "vn 0 0 1"]
    quads = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    f = ["f " + " ".join(f"{corner}/{k + 1}/{n + 1}" for k, corner in enumerate(quad)) for n, quad in enumerate(quads)]
    text = "\n".join(
        ["# a cube", "mtllib cube.mtl", *v, *vt, *vn, "g sides", "usemtl wood", "s off", *f[:4], "g lids", *f[4:]]
    )
    (folder / "cube.obj").write_text(text + "\n")
    return folder / "cube.obj"
