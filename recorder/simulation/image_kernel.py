"""The compiled inner loops: the surface behind everything, and the sensor, pixel by pixel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from pipeline.geometry import Array
from recorder.simulation.compilation import compiled
from recorder.simulation.quad_kernel import FloatImage

# A plane is drawn up to this inverse depth, 1/m.
_HORIZON = 1e-3


@compiled
def draw_plane(
    image: FloatImage,
    rays: FloatImage,
    instants: Array,
    texture: FloatImage,
    beyond: float,
) -> None:
    """Fills the image with a repeated texture on a plane.

    Args:
        image: (H, W), overwritten.
        rays: (H + 1, W + 1, 2) normalized image coordinates of the pixels' corners.
        instants: (K, 3, 3) from a ray to texels, w positive in front, at K times of the exposure.
        texture: (N, N) reflectance, N a power of two.
        beyond: reflectance of what is seen where a ray misses the plane.
    """
    height, width = image.shape
    mask = texture.shape[0] - 1
    count = instants.shape[0]
    for v in range(height):
        for u in range(width):
            x = 0.5 * (rays[v, u, 0] + rays[v + 1, u + 1, 0])
            y = 0.5 * (rays[v, u, 1] + rays[v + 1, u + 1, 1])
            total = 0.0
            for k in range(count):
                w = instants[k, 2, 0] * x + instants[k, 2, 1] * y + instants[k, 2, 2]
                if w != w:
                    continue
                if w < _HORIZON:
                    total += beyond
                    continue
                depth = 1.0 / w
                s = (instants[k, 0, 0] * x + instants[k, 0, 1] * y + instants[k, 0, 2]) * depth
                t = (instants[k, 1, 0] * x + instants[k, 1, 1] * y + instants[k, 1, 2]) * depth
                s0, t0 = np.floor(s), np.floor(t)
                fs, ft = s - s0, t - t0
                i0, j0 = int(s0) & mask, int(t0) & mask
                i1, j1 = (i0 + 1) & mask, (j0 + 1) & mask
                upper = texture[j0, i0] + fs * (texture[j0, i1] - texture[j0, i0])
                lower = texture[j1, i0] + fs * (texture[j1, i1] - texture[j1, i0])
                total += upper + ft * (lower - upper)
            image[v, u] = total / count


@compiled
def expose(image: FloatImage, gain: FloatImage, glare: FloatImage) -> None:
    """Turns reflectance into grey levels in place: image * gain + glare.

    Args:
        image: (H, W).
        gain, glare: (h, w) grey levels on an even grid whose outer nodes are the image's corners.
    """
    height, width = image.shape
    rows, cols = gain.shape
    gain_row = np.empty(cols)
    glare_row = np.empty(cols)
    for v in range(height):
        y = (v + 0.5) * (rows - 1) / height
        j = min(int(y), rows - 2)
        f = y - j
        for i in range(cols):
            gain_row[i] = gain[j, i] + f * (gain[j + 1, i] - gain[j, i])
            glare_row[i] = glare[j, i] + f * (glare[j + 1, i] - glare[j, i])
        for u in range(width):
            x = (u + 0.5) * (cols - 1) / width
            i = min(int(x), cols - 2)
            f = x - i
            image[v, u] = (
                image[v, u] * (gain_row[i] + f * (gain_row[i + 1] - gain_row[i]))
                + glare_row[i]
                + f * (glare_row[i + 1] - glare_row[i])
            )


@compiled
def _mixed(x: np.uint64) -> np.uint64:
    """Splitmix64's finalizer: a well mixed hash of a counter (Steele et al., OOPSLA 2014)."""
    x = (x ^ (x >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    x = (x ^ (x >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return x ^ (x >> np.uint64(31))


@compiled
def digitize(
    image: FloatImage, std: float, key: np.uint64, normal: FloatImage
) -> npt.NDArray[np.uint8]:
    """Adds Gaussian noise, rounds and clips to 0..255.

    Args:
        image: (H, W) grey levels.
        key: names the noise; the same key gives the same noise.
        normal: (65536,) quantiles of the standard normal distribution.
    """
    flat = image.ravel()
    out = np.empty(flat.size, np.uint8)
    bits = np.uint64(0)
    step = np.uint64(0x9E3779B97F4A7C15)
    for p in range(flat.size):
        value = float(flat[p])
        if std > 0.0:
            # Four samples of 16 bits from each hash.
            if p % 4 == 0:
                bits = _mixed(key + np.uint64(p // 4 + 1) * step)
            value += std * normal[np.int64(bits & np.uint64(0xFFFF))]
            bits >>= np.uint64(16)
        out[p] = np.uint8(min(max(np.floor(value + 0.5), 0.0), 255.0))
    return out.reshape(image.shape)
