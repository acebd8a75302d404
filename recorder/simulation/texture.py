"""Seeded, repeatable textures of ceilings and floors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np
import numpy.typing as npt

TextureKind: TypeAlias = Literal["plain", "plaster", "popcorn", "tiles", "squares"]
Texels: TypeAlias = npt.NDArray[np.float32]

_TEXELS = 2048
_PERIOD_M = 3.0


@dataclass(frozen=True, eq=False)
class Texture:
    """A texture that repeats in x and y, at several resolutions.

    Attributes:
        levels: square arrays of 1 on average; each has half the side of the one before.
        period_m: side of the repeated square.
    """

    levels: tuple[Texels, ...]
    period_m: float

    def at(self, footprint_m: float) -> Texels:
        """The level whose texels are nearest to a pixel's footprint."""
        fineness = footprint_m * len(self.levels[0]) / self.period_m
        level = round(math.log2(max(fineness, 1.0)))
        return self.levels[min(level, len(self.levels) - 1)]


@lru_cache(maxsize=4)
def texture(kind: TextureKind, contrast: float, pattern_m: float, seed: int) -> Texture:
    """The texture of that kind.

    Args:
        contrast: share by which the reflectance varies.
        pattern_m: side of a tile or square; of no effect on the others.
    """
    if kind == "plain":
        return Texture((np.ones((2, 2), np.float32),), _PERIOD_M)
    rng = np.random.default_rng([seed, 1])
    # A whole even number of tiles or squares in the repeated square.
    period_m = 2 * pattern_m * max(1, round(_PERIOD_M / (2 * pattern_m)))
    if kind == "plaster":
        relief = _noise(rng, period_m, 0.008, 0.05) + 0.5 * _noise(rng, period_m, 0.2, 1.0)
    elif kind == "popcorn":
        relief = _popcorn(rng, period_m)
    elif kind == "tiles":
        relief = _tiles(rng, period_m, pattern_m)
    else:
        relief = _squares(period_m, pattern_m) + 0.15 * _noise(rng, period_m, 0.01, 0.3)
    top = np.clip(1.0 + contrast * relief, 0.0, 2.0).astype(np.float32)
    levels = [top]
    while len(levels[-1]) > 16:
        n = len(levels[-1]) // 2
        levels.append(np.asarray(levels[-1].reshape(n, 2, n, 2).mean(axis=(1, 3))))
    for level in levels:
        level.flags.writeable = False
    return Texture(tuple(levels), period_m)


def _noise(
    rng: np.random.Generator, period_m: float, shortest_m: float, longest_m: float
) -> Texels:
    """Band-limited noise of standard deviation 1 that repeats."""
    n = _TEXELS
    spectrum = np.fft.rfft2(rng.standard_normal((n, n), dtype=np.float32))
    cycles = np.hypot(np.fft.fftfreq(n, 1 / n)[:, None], np.fft.rfftfreq(n, 1 / n)[None, :])
    per_m = cycles / period_m
    band = np.exp(-((per_m * shortest_m) ** 2)) - np.exp(-((per_m * longest_m) ** 2))
    # Falling amplitudes: no scale of the band stands out.
    spectrum *= band / np.maximum(per_m, 1.0) ** 0.7
    noise = np.fft.irfft2(spectrum, s=(n, n))
    return np.asarray(noise / noise.std(), dtype=np.float32)


def _popcorn(rng: np.random.Generator, period_m: float) -> Texels:
    """Sprayed plaster: grains, lit from one side."""
    height = np.maximum(_noise(rng, period_m, 0.02, 0.06), 0.0)
    shade = height - np.roll(height, (4, 4), (0, 1))
    relief = 0.6 * shade / shade.std() + 0.4 * _noise(rng, period_m, 0.008, 0.02)
    return np.asarray(relief, dtype=np.float32)


def _tiles(rng: np.random.Generator, period_m: float, pattern_m: float) -> Texels:
    """A suspended ceiling: tiles with pinholes between metal bars."""
    n = _TEXELS
    count = round(period_m / pattern_m)
    place = (np.arange(n) + 0.5) / n * count
    index, within = place.astype(int), np.abs(place % 1 - 0.5)
    from_bar_m = (0.5 - np.maximum(within[:, None], within[None, :])) * pattern_m
    shades = rng.normal(0.0, 0.25, (count, count))[index[:, None], index[None, :]]
    pinholes = _noise(rng, period_m, 0.006, 0.015) > 2.4
    relief = 0.3 * _noise(rng, period_m, 0.006, 0.05) + shades - 2.5 * pinholes
    relief = np.where(from_bar_m < 0.016, -2.0, relief)
    return np.asarray(np.where(from_bar_m < 0.012, 1.0, relief), dtype=np.float32)


def _squares(period_m: float, pattern_m: float) -> Texels:
    """A chessboard."""
    index = ((np.arange(_TEXELS) + 0.5) / _TEXELS * round(period_m / pattern_m)).astype(int)
    return np.where((index[:, None] + index[None, :]) % 2, 1.0, -1.0).astype(np.float32)
