"""VRTs refer to other files; these must lie in the folder of the VRT."""

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from meshflow.errors import FormatError
from meshflow.io.own_folder import must_stay_inside

__all__ = ["must_be_local"]

_FILES = ("sourcefilename", "sourcedataset", "filename", "key", "path")
# Metadata that is a file name.
_MAPS = ("X_DATASET", "Y_DATASET", "RPC_DEM")
_ADVICE = "allow_remote=True if you trust it, or gdal_translate it to .tif"
# The greatest depth of VRTs that refer to VRTs.
_DEEPEST = 16


def must_be_local(path: Path, depth: int = 0) -> None:
    """Refuse a VRT with sources outside its folder; GDAL chooses the reader of a source by its content.

    :raises FormatError: for a file outside its folder, a network, a virtual file system, or a source that
        describes other files and is no ``.vrt``.
    """
    if depth > _DEEPEST:
        raise FormatError(f"{path.name}: VRTs of VRTs, deeper than {_DEEPEST}; gdal_translate one of them to .tif")
    try:
        root = ElementTree.fromstring(path.read_bytes())
    except (ElementTree.ParseError, ValueError) as cause:
        raise FormatError(f"{path.name} cannot be read: no VRT in XML ({cause}); is it whole?") from cause
    sources, others = list(_sources(root)), list(_others(root))
    must_stay_inside(path, [*sources, *others], "a VRT", _ADVICE)
    for name in dict.fromkeys(sources):
        source = path.resolve().parent / name
        if not source.is_file():
            continue
        with source.open("rb") as file:
            start = file.read(4096).lstrip(b"\xef\xbb\xbf \t\r\n\0")
        if source.suffix.lower() == ".vrt":
            must_be_local(source, depth + 1)
        elif start[:1] in (b"<", b"{"):
            raise FormatError(f"{path.name}: its source {name[:80]!r} is no raster, it describes one; {_ADVICE}")


def _sources(root: ElementTree.Element) -> Iterator[str]:
    """The names in elements of a VRT that are file names."""
    for element in root.iter():
        tag = element.tag.rpartition("}")[2].lower() if isinstance(element.tag, str) else ""
        text = (element.text or "").strip()
        if text and (tag in _FILES or "dataset" in tag or (tag == "mdi" and element.get("key") in _MAPS)):
            yield text


def _others(root: ElementTree.Element) -> Iterator[str]:
    """Other text that looks like a name outside the folder, except in metadata."""
    for element in root.iter():
        text = (element.text or "").strip()
        if element.tag != "MDI" and ("/vsi" in text or "://" in text or text.startswith(("/", "../"))):
            yield text
