"""What a calibration came to: for other programs, for a terminal, and as a page."""

from __future__ import annotations

import base64
from importlib import resources
from typing import Any

import numpy as np

from recorder.files.camera_file import camera_yaml
from replay.calibration.calibrate import Calibration
from replay.calibration.findings import lens_text, warnings
from replay.calibration.heldout import HOW
from replay.calibration.session import Session
from replay.calibration.views import kinds_of_reasons
from replay.versions import versions


def as_dict(session: Session) -> dict[str, Any]:
    """Everything as plain values; None stands for what is not finite."""
    calibration = session.calibration
    fit, held, cover = calibration.fit, calibration.held_out, calibration.coverage
    return {
        "source": str(session.source),
        "images": session.images,
        "looked_at": session.looked_at,
        "board": str(calibration.board),
        "image_size": list(calibration.camera.image_size),
        "model": calibration.lens.model,
        "zero": [name for name in calibration.lens.names if name in calibration.lens.zero],
        "rms_px": fit.rms_px,
        "noise_px": fit.sigma_px,
        "held_out": {
            "rms_px": _number(held.rms_px),
            "folds": held.folds,
            "how": HOW.format(folds=held.folds),
        },
        "parameters": {
            name: {"value": float(value), "std": _number(std), "std_by_views": _number(by_views)}
            for name, value, std, by_views in zip(
                calibration.lens.names,
                fit.values,
                calibration.std,
                calibration.std_by_views,
                strict=True,
            )
        },
        "views": [
            {
                "name": view.name,
                "corners": len(view.pixels),
                "rms_px": float(own),
                "held_out_rms_px": _number(other),
                "blur_px": _number(view.blur_px),
                "tilt_right_deg": float(tilt[0]),
                "tilt_down_deg": float(tilt[1]),
                "distance_m": float(np.linalg.norm(pose[3:])),
            }
            for view, own, other, tilt, pose in zip(
                calibration.views,
                fit.view_rms_px,
                held.view_rms_px,
                cover.tilts_deg,
                fit.poses,
                strict=True,
            )
        ],
        "set_aside": [{"name": a.name, "reason": a.reason} for a in calibration.set_aside],
        "coverage": {
            "share": cover.share,
            "regions": cover.regions,
            "missing": cover.missing(),
        },
        "projection_std_px": {
            "median": _number(_of_known(calibration.projection_std_px, np.median)),
            "max": _number(_of_known(calibration.projection_std_px, np.max)),
            "no_ray_share": float(np.mean(~np.isfinite(calibration.projection_std_px))),
        },
        "lenses": [
            {
                "lens": lens_text(c.lens),
                "parameters": c.parameters,
                "rms_px": _number(c.rms_px),
                "held_out_rms_px": _number(c.heldout_rms_px),
            }
            for c in calibration.candidates
        ],
        "warnings": [*session.notes, *warnings(calibration)],
        "versions": versions(),
    }


def as_text(report: dict[str, Any]) -> str:
    """Some lines for a terminal, without the warnings."""
    held = report["held_out"]
    lines = [
        f"{report['source']}: {report['board']}, {len(report['views'])} views used, "
        f"{len(report['set_aside'])} images set aside{_thinned(report)}",
        *(f"  {n:4} {reason}" for reason, n in _reasons(report).items()),
        f"  {report['model']}: rms {report['rms_px']:.3f} px, on held-out views "
        f"{_shown(held['rms_px'], 3)} px",
        f"  {'':10}{'value':>12}{'std':>10}{'by views':>10}",
    ]
    for name, entry in report["parameters"].items():
        digits = 2 if name in ("fx", "fy", "cx", "cy") else 5
        cells = [_shown(entry[key], digits) for key in ("value", "std", "std_by_views")]
        lines.append(f"  {name:10}{cells[0]:>12}{cells[1]:>10}{cells[2]:>10}")
    cover = report["coverage"]["share"]
    std = report["projection_std_px"]
    lines.append(
        f"  covers {100 * cover:.0f} % of the image; far points are known to "
        f"{_shown(std['median'], 2)} px (median), {_shown(std['max'], 2)} px at worst"
    )
    return "\n".join(lines)


def as_page(report: dict[str, Any], picture_png: bytes) -> str:
    """One HTML page with everything in it."""
    import jinja2

    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    environment.filters["shown"] = _shown
    template = resources.files("replay.calibration").joinpath("report.html.j2").read_text("utf-8")
    return environment.from_string(template).render(
        report=report,
        reasons=_reasons(report),
        picture=base64.b64encode(picture_png).decode(),
    )


def camera_file(calibration: Calibration, report: dict[str, Any]) -> bytes:
    """The camera.yaml, with a line about where it is from."""
    about = (
        f"# Calibrated from {len(calibration.views)} views of {calibration.board}: rms "
        f"{report['rms_px']:.3f} px, {_shown(report['held_out']['rms_px'], 3)} px on held-out "
        "views.\n"
    )
    return about.encode() + camera_yaml(calibration.camera)


def _reasons(report: dict[str, Any]) -> dict[str, int]:
    return kinds_of_reasons(entry["reason"] for entry in report["set_aside"])


def _thinned(report: dict[str, Any]) -> str:
    if report["looked_at"] == report["images"]:
        return ""
    return f" ({report['looked_at']} of {report['images']} were looked at)"


def _of_known(values: Any, statistic: Any) -> float:
    known = values[np.isfinite(values)]
    return float(statistic(known)) if len(known) else float("nan")


def _number(value: float | None) -> float | None:
    return float(value) if value is not None and np.isfinite(value) else None


def _shown(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"
