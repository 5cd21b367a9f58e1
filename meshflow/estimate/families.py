"""What a search looks at, as data: exponents of the family, and contrasts in sample distances over the noise."""

__all__ = ["CHANNEL_FAMILY", "FAMILY", "MESH_FAMILY", "RAY_FAMILY", "Family"]

Family = tuple[tuple[dict[str, float], tuple[float, ...]], ...]
# What the search looks at where nobody names a method.
FAMILY: Family = (
    ({"patch": 1.5}, (0.4, 3.0)),
    ({"patch": 1.0, "gamma": -0.5, "sharpness": 1.5}, (2.0, 4.0)),
    ({"gamma": -1.0, "sharpness": 1.5}, (2.0, 5.0)),
    ({"gamma": -1.0, "sharpness": 2.0}, (1.0, 2.0)),
    ({"gamma": -1.0, "sharpness": 3.0}, (0.5, 1.35)),
)
# The same for several channels, of which variants with gamma -1 are stiff: stable steps shorten as edges steepen.
CHANNEL_FAMILY: Family = (
    ({}, (1.5, 3.0)),
    ({"patch": 0.7}, (2.5,)),
    ({"patch": 1.0}, (3.0,)),
    ({"patch": 1.5}, (0.4, 3.0)),
    ({"patch": 1.0, "gamma": -0.5, "sharpness": 1.5}, (1.0, 2.0)),
)
# The same on meshes.
MESH_FAMILY: Family = (
    ({}, (2.0,)),
    ({"gamma": -1.0, "sharpness": 1.5}, (2.0, 5.0)),
    ({"gamma": -1.0, "sharpness": 2.0}, (1.5,)),
)
# The same along rays, where lengths are what they are: contrast 1.
RAY_FAMILY: tuple[dict[str, float], ...] = ({}, {"gamma": -1.0}, {"gamma": 1.0})
