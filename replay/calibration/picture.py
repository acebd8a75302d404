"""The picture of a calibration: coverage, residuals, uncertainty, tilts."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

import numpy as np

from replay.calibration.calibrate import Calibration

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_INK = "#1c2127"
_CORNERS = "#0072b2"
_RC: Any = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "figure.facecolor": "white",
    "axes.edgecolor": "#9a9a9a",
}
# The median residual arrow, as a share of the image's diagonal.
_ARROW = 0.02


def picture(calibration: Calibration) -> bytes:
    """A PNG; the same calibration gives the same bytes."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    width, height = calibration.camera.image_size
    with matplotlib.rc_context(_RC):
        # A portrait image must not make the page endless.
        shape = 10.0, min(max(10.0 * height / width + 0.9, 5.0), 14.0)
        figure = Figure(figsize=shape, layout="constrained", dpi=120)
        FigureCanvasAgg(figure)
        first, second, third, fourth = figure.subplots(2, 2).ravel()
        _draw_coverage(first, calibration)
        _draw_residuals(second, calibration)
        _draw_uncertainty(third, calibration)
        _draw_tilts(fourth, calibration)
        buffer = io.BytesIO()
        figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def _image_axes(axes: Axes, calibration: Calibration) -> tuple[float, float, float, float]:
    """An empty image's outline; returns its extent."""
    width, height = calibration.camera.image_size
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    axes.set_xlim(extent[0], extent[1])
    axes.set_ylim(extent[2], extent[3])
    axes.set_aspect("equal")
    axes.set_xticks([0, width - 1])
    axes.set_yticks([0, height - 1])
    return extent


def _draw_coverage(axes: Axes, calibration: Calibration) -> None:
    cover = calibration.coverage
    extent = _image_axes(axes, calibration)
    counts = np.ma.masked_equal(cover.counts, 0)
    shown = axes.imshow(counts, extent=extent, cmap="Blues", vmin=0, aspect="equal", alpha=0.75)
    corners = np.vstack([view.pixels for view in calibration.views])
    axes.plot(*corners.T, ".", color=_INK, markersize=1.2, alpha=0.6)
    axes.set_facecolor("#f6e3d7")
    axes.set_title(
        f"Coverage: {100 * cover.share:.0f} % of the image (orange: none), {len(corners)} corners"
    )
    axes.figure.colorbar(shown, ax=axes, label="views", shrink=0.8)


def _draw_residuals(axes: Axes, calibration: Calibration) -> None:
    _image_axes(axes, calibration)
    corners = np.vstack([view.pixels for view in calibration.views])
    residuals = np.vstack(calibration.fit.residuals)
    sizes = np.linalg.norm(residuals, axis=1)
    middle = float(np.median(sizes))
    scale = middle / (_ARROW * float(np.hypot(*calibration.camera.image_size)))
    if scale > 0:
        axes.quiver(
            *corners.T, *residuals.T, color=_CORNERS, angles="xy", scale_units="xy", scale=scale,
            width=0.0016,
        )  # fmt: skip
    axes.set_title(
        f"Residuals, {1 / scale if scale > 0 else 0:.0f} times as long: rms "
        f"{calibration.fit.rms_px:.3f} px, largest {sizes.max():.2f} px"
    )


def _draw_uncertainty(axes: Axes, calibration: Calibration) -> None:
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import LogLocator, StrMethodFormatter

    extent = _image_axes(axes, calibration)
    std = np.ma.masked_invalid(calibration.projection_std_px)
    axes.set_facecolor("#c9c9c9")
    axes.set_title("Uncertainty of far points, px (grey: no ray)")
    if std.count():
        low, high = max(float(std.min()), 1e-3), max(float(std.max()), 2e-3)
        shown = axes.imshow(
            std, extent=extent, cmap="viridis_r", norm=LogNorm(low, high), aspect="equal",
            interpolation="bilinear",
        )  # fmt: skip
        bar = axes.figure.colorbar(shown, ax=axes, shrink=0.8, ticks=LogLocator(subs=(1, 2, 5)))
        bar.ax.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        bar.ax.yaxis.set_minor_formatter("")


def _draw_tilts(axes: Axes, calibration: Calibration) -> None:
    tilts = calibration.coverage.tilts_deg
    axes.plot(*tilts.T, "o", color=_CORNERS, markersize=4, zorder=3)
    for angle in (15, 30, 45):
        turn = np.linspace(0, 2 * np.pi, 90)
        axes.plot(angle * np.cos(turn), angle * np.sin(turn), color="#c9c9c9", linewidth=0.7)
        axes.annotate(f"{angle}°", (0, -angle), color="#7a7a7a", ha="center", fontsize=8)
    reach = max(50.0, float(np.abs(tilts).max()) + 5)
    axes.set_xlim(-reach, reach)
    axes.set_ylim(reach, -reach)
    axes.set_aspect("equal")
    axes.set_xlabel("to the right, degrees")
    axes.set_ylabel("down, degrees")
    axes.set_title("Tilt of the board in each view")
