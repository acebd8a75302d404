"""docs/paper.md: tables, findings and figures of the whole reproduction."""

from __future__ import annotations

import io
from pathlib import Path

import pandas as pd

from analysis.paper import site
from analysis.paper.experiments import Experiments
from analysis.paper.findings.all import all_findings
from analysis.paper.findings.finding import Finding
from analysis.paper.pictures.all import all_pictures
from analysis.paper.tables import all_tables
from analysis.paper.tracking_tables import consistency_sentences
from analysis.study import StudyFigure, StudyTable, write_files

_HEAD = """\
# The paper, reproduced

Written by `make paper`. S. Hinderer, M. Scheffler, B. Yang, *Investigation of ArUco Marker
Placement for Planar Indoor Localization*, ICAR 2025, in simulation: configuration I at both heights
and configuration II, with the paper's camera (1920x1080, f = 1360.2 px), detector (CONTOUR
corners), solver and filters.

What the paper could not know of its site is fixed here before the run: markers are placed with a
standard deviation of {position:g} mm and {yaw:g}°; the focal length is off by {focal:g} %, up or
down, and the principal point by {principal:g} px in a direction of chance. {seeds} seeds draw
these; each finding is asked of each seed. The camera's pose is exact.

Every run has exact corners of the true site with the noise of rendered frames, measured on
{standing} renderings of each height and {driving} along the drive: a mean and a covariance of a
marker's four corners together, by the slant of its edges to the pixel rows (0°, 22.5°, 45°). It is
drawn afresh for each marker and frame. A robot that moved exactly along the pixel rows would keep
the error of an edge along them for the whole side. CONTOUR moves corners inwards, by
{inward_low:.2f} px (1.334 m), {inward_high:.2f} px (2.991 m) and {inward_two:.2f} px
(configuration II); the distance of a corner from the true one is {rms_low:.2f}, {rms_high:.2f}
and {rms_two:.2f} px rms.

## Findings

A finding holds when at least 80 % of the seeds say so, and does not hold when at most 20 % do; in
between it depends on the seed. Figures in sentences are medians over the seeds, tables pool them.

| finding | here | seeds | share, 95 % |
|---|---|---|---|
"""


def write_page(runs: Experiments, page: Path) -> None:
    """The page, and its figures in a folder beside it."""
    folder = page.with_suffix("")
    seeds = len(runs.high)
    low, high, two = (
        runs.sites[name].noise
        for name in ("configuration_1_low", "configuration_1_high", "configuration_2")
    )
    findings = all_findings(runs)
    parts = [
        _HEAD.format(
            position=1000 * site.MARKER_POSITION_STD_M,
            yaw=site.MARKER_YAW_STD_DEG,
            focal=100 * site.FOCAL_ERROR,
            principal=site.PRINCIPAL_POINT_ERROR_PX,
            seeds=seeds,
            standing=site.STANDING_FRAMES,
            driving=site.DRIVING_FRAMES,
            inward_low=low.inward_px(),
            inward_high=high.inward_px(),
            inward_two=two.inward_px(),
            rms_low=low.rms_px(),
            rms_high=high.rms_px(),
            rms_two=two.rms_px(),
        )
        + "\n".join(
            f"| [{f.title}](#{anchor(f.title)}) | {f.verdict} | {sum(f.holds)} of {seeds} | "
            f"{f.interval[0]:.0%} to {f.interval[1]:.0%} |"
            for f in findings
        )
    ]
    pictures = all_pictures(runs)
    shown: dict[str, str] = {}
    for finding in findings:
        parts.append(_finding(finding, seeds))
        parts.append(_picture(pictures[finding.picture], folder.name, shown, finding.title))
    parts.append(f"## {_CONSISTENCY}")
    parts.append(
        "The tracking study's own sentences (`arucolog analyze tracking`) of the drives at "
        f"0.05 m/s, {seeds} seeds together:"
    )
    parts.append("\n".join(f"- {sentence}" for sentence in consistency_sentences(runs)))
    parts += [
        _picture(picture, folder.name, shown, _CONSISTENCY)
        for picture in pictures.values()
        if picture.name not in shown
    ]
    parts.append("## Tables")
    parts += [_table(table) for table in all_tables(runs)]
    # Everything is made; from here on only the disk can fail.
    files = {f"{folder.name}/{name}.png": _png(picture) for name, picture in pictures.items()}
    files[page.name] = ("\n\n".join(parts) + "\n").encode()
    write_files(page.parent, files)


def _png(picture: StudyFigure) -> bytes:
    buffer = io.BytesIO()
    picture.figure.savefig(buffer, format="png", dpi=110)
    return buffer.getvalue()


_CONSISTENCY = "Who is overconfident, and where"


def _picture(picture: StudyFigure, folder: str, shown: dict[str, str], title: str) -> str:
    """The figure; where an earlier section has it, a link to that section."""
    if picture.name in shown:
        where = shown[picture.name]
        return f"Figure: *{picture.title}*, under [{where}](#{anchor(where)})."
    shown[picture.name] = title
    return (
        f"![{picture.title}]({folder}/{picture.name}.png)\n\n"
        f"*{picture.title}.* {picture.caption}".rstrip()
    )


def _finding(finding: Finding, seeds: int) -> str:
    lines = [
        f"### {finding.title}",
        f"Asked: {finding.question}. **{finding.verdict.capitalize()}**, in "
        f"{sum(finding.holds)} of {seeds} seeds. Here: {finding.here}",
    ]
    if finding.because:
        lines.append(finding.because)
    return "\n\n".join(lines)


def anchor(title: str) -> str:
    """As GitHub makes it from a heading."""
    kept = "".join(c for c in title.lower() if c.isalnum() or c in " -")
    return kept.replace(" ", "-")


def _table(table: StudyTable) -> str:
    frame = table.frame
    head = "| " + " | ".join(map(str, frame.columns)) + " |"
    rule = "|" + "---|" * len(frame.columns)
    rows = [
        "| " + " | ".join(_cell(value, table.digits) for value in row) + " |"
        for row in frame.itertuples(index=False)
    ]
    return "\n".join([f"### {table.title}", "", head, rule, *rows, "", " ".join(table.notes)])


def _cell(value: object, digits: int) -> str:
    if isinstance(value, float):
        return "–" if pd.isna(value) else f"{value:.{digits}f}"
    return str(value)
