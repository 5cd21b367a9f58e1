"""Heights of the shuttle mission in a zip: taken out of it here, since GDAL does not survive a broken one."""

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from meshflow.errors import FormatError

__all__ = ["taken_out"]

# Bytes of the largest tile: 3601 x 7201 samples of 32 bit.
_LARGEST = 4 * 3601 * 7201
_BROKEN = (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError, ValueError)


@contextmanager
def taken_out(path: Path) -> Iterator[Path]:
    """The ``.hgt`` of a ``.hgt.zip`` as a file of its own, for as long as it is read; any other file as it is.

    :raises FormatError: for a broken zip, or one that holds no single tile.
    """
    if not path.name.lower().endswith(".hgt.zip"):
        yield path
        return
    with TemporaryDirectory(prefix="meshflow-") as folder:
        tile = Path(folder) / f"{path.name.split('.')[0]}.hgt"
        try:
            with zipfile.ZipFile(path) as archive:
                tiles = [one for one in archive.infolist() if one.filename.lower().endswith(".hgt")]
                if len(tiles) != 1:
                    raise FormatError(f"{path.name}: one .hgt in it expected, got {len(tiles)}; unzip it first")
                with archive.open(tiles[0]) as stored:
                    content = stored.read(_LARGEST + 1)
        except _BROKEN as cause:
            if isinstance(cause, FormatError):
                raise
            raise FormatError(f"{path.name} cannot be read (a broken zip: {cause}); get the whole file") from cause
        if len(content) > _LARGEST:
            raise FormatError(f"{path.name}: more than {_LARGEST} bytes in it; no tile is as large")
        tile.write_bytes(content)
        yield tile
