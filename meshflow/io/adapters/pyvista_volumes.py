"""Volumes of pyvista: ImageData of three axes."""

import numpy as np
import pyvista

from meshflow.geometry.validation import nowhere
from meshflow.io.document import Imported
from meshflow.io.formats.volume_arrays import must_be_no_labels
from meshflow.io.metadata import ReadOptions
from meshflow.surfaces.volume import Volume, steps_of

__all__ = ["volume_of_image_data"]


def volume_of_image_data(
    image: pyvista.ImageData, data: pyvista.DataSetAttributes, name: str, options: ReadOptions
) -> Imported:
    """Import an array of the points or cells of an ImageData; the smoothed array is of floating point.

    :param data: of the points or the cells; ``name``: of the array.
    :raises InputError: for labels.
    """
    values = np.array(data[name])
    cells = int(len(values) != image.n_points)
    nx, ny, nz = (max(size - cells, 1) for size in image.dimensions)
    block = values.reshape(nz, ny, nx, *values.shape[1:])  # x runs fastest in VTK
    must_be_no_labels(block, f"the array {name!r}")
    dx, dy, dz = map(float, image.spacing)
    spacing = (dz, dy, dx) if options.spacing is None else steps_of(options.spacing)
    volume = Volume(block, spacing, nowhere(options.without("kind").missing_in(block) if options.nodata else None))
    kept = image.copy(deep=True)

    def to_object(smoothed: Volume) -> pyvista.ImageData:
        """The grid with another array."""
        new = kept.copy(deep=True)
        place = new.cell_data if cells else new.point_data
        place[name] = np.array(smoothed.values).reshape(values.shape)
        return new

    return Imported(volume, to_object)
