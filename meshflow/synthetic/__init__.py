"""Synthetic data with a known truth: terrains, images, meshes, and simulated depth sensors, each given by a seed.

**Noisy data with its truth, one call each**: :func:`terrain`, :func:`picture`, :func:`depth_scene`, :func:`irregular_mesh`.

**Volumes**: the phantoms :func:`shepp_logan`, :func:`head`, :func:`thorax`.

**Heights**: :func:`steps`, :func:`mesas`, :func:`ramps`, :func:`fractal_terrain`; noise for them: :func:`noisy`,
:func:`quantised`.

**Meshes on a known surface** (which gives distances from it): :func:`cube`, :func:`plate`, :func:`part`, :func:`sphere`,
:func:`ring`, :func:`blob`, :func:`dome`; the method ``noisy`` adds noise.

**What instruments leave**: :class:`CorrelatedNoise`, a :class:`Camera`, :func:`striped` lines, :func:`spiked` samples.

**Depth sensors**: :func:`observe` what a :class:`StructuredLight` or :class:`TimeOfFlight` camera sees of :class:`Panel`,
:class:`Ball`, :class:`Block`, :class:`CappedBall`, or a mesh; :func:`seen` without noise.
"""

from typing import TYPE_CHECKING

from meshflow.lazy import lazily

if TYPE_CHECKING:
    from meshflow.synthetic.instruments import Camera, CorrelatedNoise, spiked, striped
    from meshflow.synthetic.phantoms import head, shepp_logan, thorax
    from meshflow.synthetic.samples import depth_scene, irregular_mesh, picture, terrain
    from meshflow.synthetic.scenes import fractal_terrain, mesas, noisy, quantised, ramps, steps
    from meshflow.synthetic.sensors import Frame, StructuredLight, TimeOfFlight, observe, seen
    from meshflow.synthetic.shapes import Noise, Shape, blob, cube, dome, part, plate, ring, sphere
    from meshflow.synthetic.solids import Ball, Block, CappedBall, Panel

__all__ = [
    "Ball",
    "Block",
    "Camera",
    "CappedBall",
    "CorrelatedNoise",
    "Frame",
    "Noise",
    "Panel",
    "Shape",
    "StructuredLight",
    "TimeOfFlight",
    "blob",
    "cube",
    "depth_scene",
    "dome",
    "fractal_terrain",
    "head",
    "irregular_mesh",
    "mesas",
    "noisy",
    "observe",
    "part",
    "picture",
    "plate",
    "quantised",
    "ramps",
    "ring",
    "seen",
    "shepp_logan",
    "sphere",
    "spiked",
    "steps",
    "striped",
    "terrain",
    "thorax",
]

__getattr__, __dir__ = lazily(
    __name__,
    {
        "instruments": ("Camera", "CorrelatedNoise", "spiked", "striped"),
        "phantoms": ("head", "shepp_logan", "thorax"),
        "samples": ("depth_scene", "irregular_mesh", "picture", "terrain"),
        "scenes": ("fractal_terrain", "mesas", "noisy", "quantised", "ramps", "steps"),
        "sensors": ("Frame", "StructuredLight", "TimeOfFlight", "observe", "seen"),
        "shapes": ("Noise", "Shape", "blob", "cube", "dome", "part", "plate", "ring", "sphere"),
        "solids": ("Ball", "Block", "CappedBall", "Panel"),
    },
)
