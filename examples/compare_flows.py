"""Four flows on a simulated depth camera: in all of space, along vertex normals, of z alone, and along the rays.

Each runs until its surface is as smooth as that of the ray flow. What lies inside a surface they then measure about alike; at
silhouettes the first three move points off their rays, so that pixels lose their surface or see another one behind it.

``python examples/compare_flows.py [PICTURE.png]`` draws them, too.
"""

import sys
from pathlib import Path

from meshflow import Pinhole
from meshflow.evaluate import compare_flows
from meshflow.surfaces.visibility import Sight
from meshflow.synthetic.samples import SCENE
from meshflow.synthetic.sensors import StructuredLight, observe


def main(picture: Path | None = None) -> tuple[float, float, float]:
    """Drift of silhouettes, pixels, along rays and least of the others; the normal error of the rays over that before."""
    camera, shape = Pinhole(120.0, 120.0, 63.5, 47.5), (96, 128)
    frame = observe(SCENE, Sight.through(camera, shape), StructuredLight(baseline=0.075, focal=575.0, seed=0))

    compared = compare_flows(frame.depth, camera, frame.truth)

    print(compared)
    if picture is not None:
        from meshflow.view import flows

        print(flows(compared.panels(), picture, title="Four flows on a simulated depth camera").path)
    drifts = {name: outcome.drift_rms or 0.0 for name, outcome in compared.after.items()}
    rays = compared.after["rays"]
    others = min(drift for name, drift in drifts.items() if name != "rays")
    return drifts["rays"], others, (rays.normal_error or 0.0) / (compared.before.normal_error or 1.0)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else None)
