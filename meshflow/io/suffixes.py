"""The extensions of files, of which some have two parts."""

from pathlib import Path

__all__ = ["suffix_of"]


def suffix_of(path: Path) -> str:
    """The extension in lower case, of which ``.nii.gz`` is one."""
    return ".nii.gz" if path.name.lower().endswith(".nii.gz") else path.suffix.lower()
