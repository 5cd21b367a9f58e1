"""The configurations that a search tries: exponents of the family, and contrasts in sample distances over the noise."""

from dataclasses import replace

from meshflow.estimate.risk import Configuration
from meshflow.flow.family import Variant

__all__ = ["CHANNEL_FAMILY", "FAMILY", "MESH_FAMILY", "RAY_FAMILY", "Family", "configurations"]

Family = tuple[tuple[dict[str, float], tuple[float, ...]], ...]
# The configurations of a search where no method is named. For the first two slopes are not edges, and with twicing they preserve
# bowls and ridges: the heat equation, whatever the slope, and nearly the same, with finer edges.
FAMILY: Family = (
    ({"linear": True}, (1.0,)),
    ({}, (0.1,)),
    ({"patch": 1.5}, (0.4, 3.0)),
    ({"patch": 1.0, "gamma": -0.5, "sharpness": 1.5}, (2.0,)),
    ({"gamma": -1.0, "sharpness": 1.5}, (5.0,)),
    ({"gamma": -1.0, "sharpness": 2.0}, (1.0, 2.7)),
    ({"gamma": -1.0, "sharpness": 3.0}, (0.5, 1.35)),
)
# The same for several channels, for which variants with gamma -1 are stiff: stable steps shorten as edges steepen.
CHANNEL_FAMILY: Family = (
    ({}, (1.5, 3.0)),
    ({"patch": 0.7}, (2.5,)),
    ({"patch": 1.0}, (3.0,)),
    ({"patch": 1.5}, (0.4, 3.0)),
    ({"patch": 1.0, "gamma": -0.5, "sharpness": 1.5}, (1.0, 2.0)),
)
# The same for meshes; the first one is the heat equation, which has no contrast.
MESH_FAMILY: Family = (
    ({"linear": True}, (1.0,)),
    ({}, (0.5, 1.2, 2.5)),
    ({"gamma": -1.0, "sharpness": 1.5}, (0.6, 2.0, 5.0)),
    ({"gamma": -1.0, "sharpness": 2.0}, (0.5, 1.5)),
)
# The same along rays, where the contrast is 1.
RAY_FAMILY: tuple[dict[str, float], ...] = ({}, {"gamma": -1.0}, {"gamma": 1.0})


def configurations(family: Family, unit: float, like: Variant, contrast: float | None) -> tuple[Configuration, ...]:
    """The configurations of a family.

    :param unit: h / sigma, the unit of contrasts.
    :param like: gives indicator, mass and floor.
    :param contrast: given, of the configurations that have one; None: those of the family.
    """
    made = [
        Configuration(replace(like, **exponents), contrast or edge * unit)
        for exponents, edges in family
        for edge in edges
        if contrast is None or not exponents.get("linear")
    ]
    return tuple(dict.fromkeys(made))
