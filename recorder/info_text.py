"""`arucolog info` for people."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from recorder.bench.marks import marks_text
from recorder.info import OPERATOR, LogInfo, TruthInfo
from recorder.quantities import size_text

_SHOWN = 10
_COUNTS = {
    "frames_dropped": "dropped",
    "frames_late": "late",
    "frames_corrupt": "corrupt",
    "frames_stamped_back": "with a stamp that jumps back",
    "frames_inspected": "decoded to look for damage",
    "display_dropped": "not shown",
}


def info_text(info: LogInfo) -> str:
    """Aligned lines, without one for what the log does not have to say."""
    rows = [
        ("log", f"{info.path} ({size_text(info.bytes)})"),
        ("ended", info.shortfall or info.ended),
        ("images", _images(info)),
        ("recorded", _recorded(info.recorded)),
        ("time", _time(info)),
        ("camera", _camera(info)),
        ("map", _map(info)),
        ("truth", _truth(info.truth)),
        ("marks", marks_text(info.marks)),
        ("events", ", ".join(f"{n} {level}" for level, n in info.events_by_level.items())),
    ]
    gaps = info.images.gaps
    rows += [
        (
            "gap",
            f"{gap.pause_s:.3f} s after frame {gap.after_frame} at {gap.at_s:.3f} s"
            + (f", {counted(gap.missing, 'frame')} missing" if gap.missing else ""),
        )
        for gap in gaps[:_SHOWN]
    ]
    if len(gaps) > _SHOWN:
        rows.append(("gap", f"... {len(gaps)} in all"))
    events = [e for k, e in enumerate(info.events) if k < _SHOWN or e["by"] == OPERATOR]
    rows += [("event", f"{e['at_s']:.3f} s {e['level']}: {e['text']}") for e in events]
    if (in_all := sum(info.events_by_level.values())) > len(events):
        rows.append(("event", f"... {in_all} in all"))
    rows += [("problem", text) for text in info.problems]
    rows += sorted(info.session.items())
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {text}" for name, text in rows if text)


def counted(count: int, noun: str) -> str:
    """`1 pose`, `2 poses`."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _images(info: LogInfo) -> str:
    images = info.images
    if not images.count:
        return "none"
    size = f"{images.width_px}x{images.height_px} " if images.width_px else ""
    formats = ", ".join(images.formats)
    missing = f", {images.missing} missing" if images.missing else ""
    mean = size_text(images.bytes // images.count)
    return f"{images.count} {size}{formats}, {mean} each{missing}"


def _recorded(recorded: Mapping[str, Any]) -> str:
    """What the recorder counted, without what it did not find."""
    parts = [f"{recorded[name]} {what}" for name, what in _COUNTS.items() if recorded.get(name)]
    if lost := recorded.get("connection_lost"):
        seconds, at_end = recorded.get("connection_lost_s"), recorded.get("connection_lost_at_end")
        parts.append(outage_text(lost, seconds or 0.0, at_end=bool(at_end)))
    return ", ".join(parts)


def outage_text(count: int, seconds: float, *, at_end: bool) -> str:
    """Lost connections, `seconds` in all."""
    times = "once" if count == 1 else f"{count} times"
    end = ", and not back at the end" if at_end else ""
    return f"connection lost {times}, for {seconds:.1f} s in all{end}"


def _time(info: LogInfo) -> str:
    images = info.images
    if images.first_timestamp_ns is None:
        return ""
    rate = f" at {images.rate_hz:.2f} frames/s" if images.rate_hz else ""
    start = datetime.fromtimestamp(images.first_timestamp_ns // 10**9, UTC)
    return f"{images.duration_s:.3f} s{rate}, from {start:%Y-%m-%d %H:%M:%S} UTC"


def _camera(info: LogInfo) -> str:
    camera = info.camera
    if camera is None:
        return "none: replay needs --camera"
    return (
        f"{camera.name}, {camera.width_px}x{camera.height_px}, {camera.distortion_model}, "
        f"f {camera.fx_px:.1f} {camera.fy_px:.1f}, c {camera.cx_px:.1f} {camera.cy_px:.1f} px"
    )


def _map(info: LogInfo) -> str:
    marker_map = info.map
    if marker_map is None:
        return "none: replay needs --map"
    sizes = ", ".join(f"{size:g}" for size in marker_map.sizes_m)
    return (
        f"{counted(marker_map.markers, 'marker')} of {sizes} m, {marker_map.dictionary}, "
        f"frame {marker_map.frame}"
    )


def _truth(truth: TruthInfo | None) -> str:
    if truth is None:
        return "none"
    counts = (
        (truth.path_points, "path of {}", "point"),
        (truth.stood_poses, "{} stood at", "pose"),
        (truth.waypoints, "{}", "waypoint"),
        (truth.trajectory_poses, "trajectory of {}", "pose"),
        (truth.exact_poses, "{}", "exact pose"),
    )
    parts = [text.format(counted(n, noun)) for n, text, noun in counts if n]
    return ", ".join(parts) + (f" ({truth.method})" if truth.method else "")
