"""Whether the noise of one or several channels is correlated, and how it is correlated between channels.

Tiles of the usual side are looked at first. Where edges are dense none of them is flat; then smaller ones are.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, reduce

import numpy as np

from meshflow.estimate.noise_spectrum import HINT, LEAST, MISFIT, WAVES, Found, spectral_noise
from meshflow.estimate.noise_tiles import SIDES, Tiles, folded, tiles_of, tiling
from meshflow.geometry.validation import Array

__all__ = ["ChannelPart", "Spectra", "spectra_of"]

# Channels together: the median factor, the gain, that of independent channels added, and the least length; the number of tiles of
# all, and the largest ratio of lengths. Of 80 crops by a simulated camera 0.81 are recognized, by their channels alone 0.55.
OF_CHANNELS = (2.0, 40.0, 0.5)
FEW_OF_CHANNELS, UNLIKE = 12, 1.6
# Above this mean correlation between channels the noise may be texture: of 96 crops by a simulated camera 7 are above it, whose
# noise is found 16 to 208 % too large, in one 35 % too small.
SAME = 0.6

ChannelPart = tuple[list[tuple[Array, Array]], bool, bool]


@dataclass(frozen=True, eq=False)
class Spectra:
    """The noise in the flattest tiles of each channel.

    :ivar tiles: of each channel.
    :ivar found: of each channel; None where there are too few tiles.
    """

    tiles: tuple[Tiles, ...]
    found: tuple[Found | None, ...]

    @cached_property
    def between(self) -> Array | None:
        """(k, k), the correlation of the noise between channels; None for one channel, or if it cannot be estimated."""
        every = self._every
        return _between(self.tiles, every) if len(every) > 1 else None

    @cached_property
    def together(self) -> bool:
        """Whether the channels together show that their noise is correlated."""
        every = self._every
        return len(every) > 1 and _correlated_together(every, self.between)

    @property
    def doubt(self) -> str:
        """Why correlated noise may be texture; empty if it differs between channels."""
        if self.between is None or not self.correlated:
            return ""
        same = float(self.between[np.triu_indices(len(self.between), 1)].mean())
        return "it is nearly the same in all channels, as texture is" if same > SAME else ""

    @property
    def correlated(self) -> bool:
        """Whether the noise of any channel is correlated."""
        return any(self.of_each)

    @cached_property
    def of_each(self) -> tuple[bool, ...]:
        """Whether the noise of each channel is correlated: beyond doubt, or like that of one whose noise is."""
        sure = [one for one in self.found if one is not None and one.correlated]
        return tuple(
            one is not None and (self.together or one.correlated or any(_alike(one, other) for other in sure))
            for one in self.found
        )

    @property
    def hint(self) -> bool:
        """Whether correlated noise is likelier than white noise in any channel."""
        return any(one is not None and one.evidence > HINT for one in self.found)

    @property
    def _every(self) -> tuple[Found, ...]:
        """Those of all channels; empty if one has none."""
        known = tuple(one for one in self.found if one is not None)
        return known if len(known) == len(self.found) else ()


def spectra_of(channels: Sequence[ChannelPart]) -> Spectra:
    """The noise of channels from tiles of the usual side, or from smaller ones if these alone show that it is correlated.

    :param channels: of each its pieces (h, w) with the masks of present samples, and whether rows and columns have offsets.
    """
    usual: Spectra | None = None
    for side in SIDES:
        tiles = tuple(tiles_of(parts, side) for parts, _, _ in channels)
        found = (spectral_noise(one, rows, columns) for one, (_, rows, columns) in zip(tiles, channels, strict=True))
        spectra = Spectra(tiles, tuple(found))
        usual = usual or spectra
        if spectra.correlated or not spectra.hint:
            return spectra if spectra.correlated else usual
    return usual if usual is not None else Spectra((), ())


def _alike(found: Found, sure: Found) -> bool:
    """Whether the noise of a channel may be correlated as that of another one is beyond doubt."""
    own, other = (float(np.sqrt(np.prod(one.spectrum.lengths))) for one in (found, sure))
    return (
        found.evidence > HINT
        and max(own, other) < UNLIKE * min(own, other)
        and found.error < MISFIT
        and found.scatter > WAVES
    )


def _correlated_together(found: Sequence[Found], between: Array | None) -> bool:
    """Whether the noise of several channels is correlated, which they say together where one alone is in doubt.

    Noise differs between channels and texture hardly does: the gains of log likelihood count as far as channels are independent.

    :param between: (k, k), the correlation of the supposed noise between channels; None: no common tiles, independent.
    """
    k = len(found)
    above, evidence, length = OF_CHANNELS
    same = 0.0 if between is None else float(np.abs(between[np.triu_indices(k, 1)]).mean())
    gained = float(np.sum([one.evidence for one in found])) / (1.0 + (k - 1) * same)
    wide = [max(one.spectrum.lengths) for one in found]
    lengths = [float(np.sqrt(np.prod(one.spectrum.lengths))) for one in found]
    return (
        gained > evidence
        and float(np.median([one.above for one in found])) > above
        and min(wide) >= length
        and max(wide) < min(one.widest for one in found)
        and max(lengths) < UNLIKE * min(lengths)
        and sum(one.tiles for one in found) >= FEW_OF_CHANNELS
        and max(one.error for one in found) < MISFIT
        and min(one.scatter for one in found) > WAVES
    )


def _between(channels: Sequence[Tiles], found: Sequence[Found]) -> Array | None:
    """The correlation (k, k) of the noise between channels, from the tiles that were chosen in all of them.

    :returns: None for too few such tiles.
    """
    seen = [tiles.names[one.chosen] for tiles, one in zip(channels, found, strict=True)]
    common = reduce(np.intersect1d, seen)
    if common.size < LEAST:
        return None
    at = tiling(channels[0].side).at
    surface = np.max([one.spectrum.of_surface(at) / one.power for one in found], axis=0)
    weights = at.weights * (surface < 0.5)
    if not weights.any():
        return None
    parts = [one.transform[np.searchsorted(one.names, common)] for one in channels]
    cross = np.array([[folded(np.real(a * np.conj(b))).mean(axis=0) @ weights for b in parts] for a in parts])
    spread = np.sqrt(np.diag(cross))
    return cross / np.outer(spread, spread)
