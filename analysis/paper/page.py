"""docs/paper.md: tables, findings and figures of the whole reproduction."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from analysis.paper import site
from analysis.paper.experiments import Experiments
from analysis.paper.findings import Finding, all_findings
from analysis.paper.pictures import all_pictures
from analysis.paper.tables import all_tables
from analysis.study import StudyTable

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
{frames} renderings of each configuration: a mean and a covariance of a marker's four corners
together, by class of rotation. CONTOUR moves corners inwards, by {inward_low:.2f} px (1.334 m),
{inward_high:.2f} px (2.991 m) and {inward_two:.2f} px (configuration II); the distance of a
corner from the true one is {rms_low:.2f}, {rms_high:.2f} and {rms_two:.2f} px rms.

## Findings

| finding | here | seeds |
|---|---|---|
"""


def write_page(runs: Experiments, page: Path) -> None:
    """The page, and its figures in a folder beside it."""
    folder = page.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
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
            frames=site.NOISE_FRAMES,
            inward_low=low.inward_px(),
            inward_high=high.inward_px(),
            inward_two=two.inward_px(),
            rms_low=low.rms_px(),
            rms_high=high.rms_px(),
            rms_two=two.rms_px(),
        )
        + "\n".join(
            f"| [{f.title}](#{_anchor(f.title)}) | {f.verdict} | {sum(f.holds)} of {seeds} |"
            for f in findings
        )
    ]
    parts += [_finding(finding, seeds) for finding in findings]
    parts.append("## Tables")
    parts += [_table(table) for table in all_tables(runs)]
    parts.append("## Figures")
    for picture in all_pictures(runs):
        path = folder / f"{picture.name}.png"
        picture.figure.savefig(path, dpi=110)
        parts.append(
            f"### {picture.title}\n\n![{picture.title}]({folder.name}/{path.name})\n\n"
            f"{picture.caption}"
        )
    page.write_text("\n\n".join(parts) + "\n")


def _finding(finding: Finding, seeds: int) -> str:
    lines = [
        f"### {finding.title}",
        f"Asked: {finding.question}. **{finding.verdict.capitalize()}**, in "
        f"{sum(finding.holds)} of {seeds} seeds. Here: {finding.here}",
    ]
    if finding.because:
        lines.append(finding.because)
    return "\n\n".join(lines)


def _anchor(title: str) -> str:
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
