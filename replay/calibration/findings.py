"""What a person should know before using a calibration."""

from __future__ import annotations

import numpy as np

from replay.calibration.board import Charuco
from replay.calibration.calibrate import Calibration
from replay.calibration.heldout import Candidate, as_good_and_simpler, better
from replay.calibration.lens import Lens
from replay.calibration.marker_size import as_measured

_COVERED = 0.6
_FOCAL_SHARE = 0.01
_CENTRE_SHARE = 0.01
_PROJECTION_PX = 1.0
_PROJECTION_PERCENT = 5
_RMS_PX = 1.0
_TOGETHER = 3.0
_OVERFIT = 1.5
_ASPECT = 0.02


def lens_text(lens: Lens) -> str:
    """`plumb_bob without k3`."""
    zero = [name for name in lens.names if name in lens.zero]
    return lens.model + (f" without {', '.join(zero)}" if zero else "")


def lens_options(lens: Lens) -> str:
    """What gives this lens on the command line."""
    return " ".join(
        [f"--model {lens.model}", *(f"--zero {name}" for name in lens.names if name in lens.zero)]
    )


def warnings(calibration: Calibration) -> list[str]:
    """One line each; none for a calibration to be trusted."""
    return [
        *_of_board(calibration),
        *_of_views(calibration),
        *_of_uncertainty(calibration),
        *_of_lens(calibration),
    ]


def _of_board(calibration: Calibration) -> list[str]:
    board = calibration.board
    if not isinstance(board, Charuco):
        return []
    measured = as_measured(board, [view.marker_share for view in calibration.views])
    if measured is None:
        return []
    return [
        f"the markers measure {measured.marker_m / board.square_m:.2f} of the squares' side, about "
        f"{measured.marker_m:g} m in squares of {board.square_m:g} m, not {board.marker_m:g} m: if "
        f"the squares' side is right, --board {measured}; else measure both"
    ]


def _of_views(calibration: Calibration) -> list[str]:
    found = []
    cover = calibration.coverage
    missing = cover.missing()
    if missing or cover.share < _COVERED:
        where = missing or "of the parts of the image that it was not in"
        found.append(
            f"the board was within {100 * cover.share:.0f} % of the image; take more views {where}"
        )
    fit = calibration.fit
    if fit.rms_px > _RMS_PX:
        found.append(
            f"the rms of {fit.rms_px:.2f} px is large: is the board flat and the one that was "
            "named, were the images sharp?"
        )
    return found


def _of_uncertainty(calibration: Calibration) -> list[str]:
    found = []
    values = dict(zip(calibration.lens.names, calibration.fit.values, strict=True))
    std = dict(zip(calibration.lens.names, calibration.std, strict=True))
    by_views = dict(zip(calibration.lens.names, calibration.std_by_views, strict=True))
    width, height = calibration.camera.image_size
    limits = {
        "fx": _FOCAL_SHARE * values["fx"],
        "fy": _FOCAL_SHARE * values["fy"],
        "cx": _CENTRE_SHARE * width,
        "cy": _CENTRE_SHARE * height,
    }
    large = [
        f"{name} {values[name]:.1f} ± {max(std[name], by_views[name]):.1f} px"
        for name, limit in limits.items()
        if not max(std[name], by_views[name]) <= limit
    ]
    if large:
        found.append(f"uncertain: {', '.join(large)}; more views, nearer and more tilted, help")
    worst = calibration.projection_std_px
    if not np.isfinite(worst).all() and not _sees_a_half_space(calibration):
        found.append(
            f"in {100 * np.mean(~np.isfinite(worst)):.0f} % of the image the lens gives no ray: "
            "it was bent to fit where the board was, and fails beyond"
        )
    known = worst[np.isfinite(worst)]
    if len(known) and np.percentile(known, 100 - _PROJECTION_PERCENT) > _PROJECTION_PX:
        found.append(
            f"in {_PROJECTION_PERCENT} % of the image the place of far points is uncertain by "
            f"{np.percentile(known, 100 - _PROJECTION_PERCENT):.1f} px or more (one standard "
            "deviation); the picture shows where more views are needed"
        )
    ratio = max(by_views[name] / std[name] for name in ("fx", "fy", "cx", "cy"))
    if ratio > _TOGETHER:
        found.append(
            f"views disagree {ratio:.1f} times more than their corners' noise: trust the standard "
            "deviations by views; a board that is not flat, motion or a rolling shutter do this"
        )
    return found


def _sees_a_half_space(calibration: Calibration) -> bool:
    """A fisheye lens that is sound up to 90° off the axis: what is farther has no ray before it."""
    if calibration.lens.model != "equidistant":
        return False
    angle = np.linspace(0, np.pi / 2, 200)
    k = calibration.fit.values[4:]
    bent = angle * (1 + sum(k[i] * angle ** (2 * i + 2) for i in range(4)))
    return bool((np.diff(bent) > 0).all())


def _of_lens(calibration: Calibration) -> list[str]:
    found = []
    held, own = calibration.held_out.rms_px, calibration.fit.rms_px
    if not held <= _OVERFIT * own:
        found.append(
            f"views that were held out fit {held / own:.1f} times worse ({held:.2f} px) than those "
            f"fitted ({own:.2f} px): more views, or fewer parameters"
        )
    simpler = as_good_and_simpler(calibration.candidates)
    other = better(calibration.candidates)
    if simpler is not None and (other is None or other.simpler):
        found.append(
            f"{lens_text(simpler.lens)} ({simpler.parameters} parameters instead of "
            f"{calibration.candidates[0].parameters}) does as well on held-out views, "
            f"{_errors(simpler)} against {held:.3f} px: {lens_options(simpler.lens)}"
        )
    elif other is not None:
        found.append(
            f"{lens_text(other.lens)} does better on held-out views, "
            f"{_errors(other)} against {held:.3f} px: {lens_options(other.lens)}"
        )
    fx, fy = calibration.fit.values[:2]
    if abs(fx / fy - 1) > _ASPECT:
        found.append(
            f"fx and fy differ by {100 * abs(fx / fy - 1):.1f} %: is the print of the same scale "
            "both ways?"
        )
    return found


def _errors(candidate: Candidate) -> str:
    return f"{candidate.heldout_rms_px:.3f} px"
