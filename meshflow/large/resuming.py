"""Whether a file that is there is what a run would write: its tags say of which samples and numbers it was made."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from hashlib import blake2b

import numpy as np

__all__ = ["DEPENDS", "digest_of", "unlike"]

# The tag with the digest of all that decides the samples; and tags that do not decide them.
DEPENDS = "depends_on"
_BESIDE = ("stopped_because", "threads")
# Bytes of a digest.
_LENGTH = 8


def digest_of(objects: Iterable[object]) -> str:
    """A short text that differs where a number or a word in any of the objects does; the same on every machine."""
    made = blake2b(digest_size=_LENGTH)
    for part in _parts(tuple(objects)):
        made.update(len(part).to_bytes(8, "little") + part)
    return made.hexdigest()


def unlike(there: Mapping[str, str], tags: Mapping[str, str]) -> str | None:
    """In what a file was made otherwise than this run makes it, for a sentence; None: in nothing.

    :param there: the tags of the file; ``tags``: those of the run, text that is compared as it is written.
    """
    names = [name for name in tags if name not in _BESIDE and there.get(name, "").strip() != tags[name].strip()]
    if not names:
        return None
    said = [name.replace("_", " ") for name in names if name != DEPENDS]
    return f"another {', '.join(said)}" if said else "other tiles or options"


def _parts(value: object) -> Iterator[bytes]:
    """The numbers and words of an object, with the names of the types that hold them."""
    if isinstance(value, (np.ndarray, np.generic)) and value.dtype != object:
        found = np.ascontiguousarray(value)
        yield f"{found.dtype.str}{np.shape(value)}".encode()
        yield found.tobytes()
    elif isinstance(value, Mapping):
        yield b"mapping %d" % len(value)
        yield from _parts(tuple(sorted(value.items(), key=lambda item: repr(item[0]))))
    elif isinstance(value, (tuple, list)):
        yield b"sequence %d" % len(value)
        for one in value:
            yield from _parts(one)
    elif isinstance(value, type):
        yield value.__qualname__.encode()
    elif is_dataclass(value):
        yield type(value).__qualname__.encode()
        for each in fields(value):
            if each.name != "threads":
                yield from _parts((each.name, getattr(value, each.name)))
    else:
        yield repr(value).encode()
