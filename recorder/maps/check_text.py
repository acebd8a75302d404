"""`arucolog map check` for people."""

from __future__ import annotations

from recorder.info_text import counted
from recorder.maps.check import MapCheck, MarkerRow

_HEAD = ("id", "x_m", "y_m", "z_m", "size_m", "faces", "tilt_deg", "nearest", "apart_m", "gap_m")


def check_text(check: MapCheck) -> str:
    """The markers, what was found, and the verdict."""
    named = {i for finding in check.findings if finding.severity != "note" for i in finding.ids}
    lines = _aligned([_HEAD, *(_cells(row) for row in check.markers)])
    marks = [" ", *("!" if row.id in named else " " for row in check.markers)]
    text = [f"{mark} {line}" for mark, line in zip(marks, lines, strict=True)]
    text = [*text, ""] if check.markers else []
    text += [f"{finding.severity}: {finding.text}" for finding in check.findings]
    verdict = "sane" if check.sane else "not usable as it is"
    counts = ", ".join(
        (
            counted(len(check.markers), "marker") + f" of {check.dictionary or 'no dictionary'}",
            counted(check.count("error"), "error"),
            counted(check.count("warning"), "warning"),
        )
    )
    text.append(f"{check.path}: {verdict}; {counts}")
    return "\n".join(text)


def _cells(row: MarkerRow) -> tuple[str, ...]:
    near = ("", "", "")
    if row.nearest is not None:
        near = (str(row.nearest.id), f"{row.nearest.distance_m:.3f}", f"{row.nearest.gap_m:.3f}")
    return (
        str(row.id),
        *(f"{value:.3f}" for value in row.xyz_m),
        f"{row.size_m:.4g}",
        row.facing,
        f"{row.tilt_deg:.2f}",
        *near,
    )


def _aligned(rows: list[tuple[str, ...]]) -> list[str]:
    widths = [max(len(cell) for cell in column) for column in zip(*rows, strict=True)]
    return ["  ".join(f"{c:>{w}}" for c, w in zip(row, widths, strict=True)) for row in rows]
