"""A survey for people, as JSON, and as the map.yaml it gives."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from pipeline.geometry import Pose
from pipeline.markers import Marker
from recorder.files.map_file import map_yaml
from replay.survey.results import IMPLAUSIBLE_SIGMAS, ODD_EDGE_SIGMAS, Survey, SurveyedMarker
from replay.survey.sightings import FrameCount

_HEADER = (
    "marker", "frames", "dx", "dy", "dz", "dyaw", "tilt", "±x", "±y", "±z", "±yaw", "±tilt", ""
)  # fmt: skip
# Of the markers that may move; slips of the tape measure are rarer.
_MANY = 0.5
# Of the distance between those farthest apart: beyond what is fixed, errors grow as on a lever.
_SPAN = 0.4
_UNITS = ("", "", "mm", "mm", "mm", "deg", "deg", "mm", "mm", "mm", "deg", "deg", "")


def survey_text(survey: Survey, count: FrameCount) -> str:
    """What was found, a table of the markers, and what to look at."""
    rows = [_HEADER, _UNITS, *(_row(marker) for marker in survey.markers)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(_HEADER))]
    table = ["  ".join(c.rjust(w) for c, w in zip(row[:-1], widths, strict=False)) for row in rows]
    lines = [f"{line}  {row[-1]}".rstrip() for line, row in zip(table, rows, strict=True)]
    return "\n".join([*lines, "", *_findings(survey, count)])


def _row(marker: SurveyedMarker) -> tuple[str, ...]:
    seen = (str(marker.id), str(marker.seen))
    if marker.fixed:
        return (*seen, *["-"] * 10, "fixed")
    moved = [f"{1e3 * value:+.1f}" for value in marker.shift_m]
    turned = (f"{math.degrees(marker.yaw_rad):+.2f}", f"{math.degrees(marker.tilt_rad):.2f}")
    sure = [f"{1e3 * value:.1f}" for value in marker.shift_sigma_m]
    turn_sure = (f"{math.degrees(s):.2f}" for s in (marker.yaw_sigma_rad, marker.tilt_sigma_rad))
    notes = []
    if marker.implausible:
        notes.append(f"{marker.sigmas:.1f} sigma off: measure again")
    if marker.rejected:
        notes.append(f"{marker.rejected} views left out")
    return (*seen, *moved, *turned, *sure, *turn_sure, "; ".join(notes))


def _findings(survey: Survey, count: FrameCount) -> list[str]:
    lines = [
        f"{survey.frames} frames used of {count.read} looked at"
        f"{_reasons(count, survey)}; {survey.observations} views of "
        f"{len(survey.markers)} markers, {survey.rejected} more left out as too far off",
        f"corners fit to {survey.rms_after_px:.2f} px rms, with the map as it was "
        f"{survey.rms_before_px:.2f} px; the camera's calibration is taken as exact",
        f"edges are seen {survey.edge_px:.2f} ± {survey.edge_sigma_px:.3f} px inside the true "
        "ones, which is made up for",
        f"corners err by {survey.sigma_px:.2f} px, alike in {survey.correlation:.1f} frames on "
        f"end, and each marker's own by {survey.bias_px:.3f} px in all; the uncertainties "
        "count that",
    ]
    fixed = [marker.id for marker in survey.markers if marker.fixed]
    if fixed:
        lines.append(
            f"uncertainties are relative to what is fixed: {listed(fixed)}. Its own errors are the "
            "whole map's: fix what was measured much better than the rest, or nothing"
        )
    else:
        lines.append(
            "nothing that was seen is fixed: as a whole the map is where the hand measurements have"
            " it on average"
        )
    return lines


def warnings(survey: Survey) -> list[str]:
    """What a person should know before using the refined map."""
    lines = []
    if survey.unseen:
        lines.append(f"not seen beside another marker, left as measured: {listed(survey.unseen)}")
    fixed = survey.options.fix
    if disowned := set(survey.disowned) - fixed:
        lines.append(
            "seen, but the corners fit nowhere (another size? moved in between? two of it?), left "
            f"as measured: {listed(disowned)}"
        )
    if survey.contradicted:
        lines.append(
            "fixed, but not where the images have it beside the others that are fixed: "
            f"{listed(survey.contradicted)}. The refined map is bent between them by more than its "
            "std_m: one of all these is not where it was measured, fix those only that are sure"
        )
    if text := _close_together(survey):
        lines.append(text)
    if survey.edge_sigmas > ODD_EDGE_SIGMAS:
        lines.append(
            f"edges are seen {survey.edge_px:.2f} px inside the true ones, expected were "
            f"{survey.options.edges.mean_px:.2f}: a size or the distances of the markers may be "
            "wrong by a few percent"
        )
    if missed := fixed & {*survey.unseen, *survey.disowned}:
        lines.append(
            f"fixed, but of no use here, so that nothing is tied to them: {listed(missed)}"
        )
    if len(survey.groups) > 1:
        groups = "; ".join(listed(group) for group in survey.groups)
        lines.append(
            f"no frame ties these groups of markers together: {groups}. How one lies to another "
            "rests on the hand measurements alone"
        )
    again = [marker.id for marker in survey.markers if marker.implausible]
    if again:
        lines.append(
            f"shifted by more than {IMPLAUSIBLE_SIGMAS:g} standard deviations of the hand "
            f"measurement, measure again: {listed(again)}"
        )
    if len(again) > _MANY * sum(not marker.fixed for marker in survey.markers):
        lines.append(
            "that is most of them: is the calibration this camera's, are --std-m and --std-deg "
            "what the measurements are good to?"
        )
    if not survey.converged:
        lines.append("the solution has not settled: the log says little about some marker")
    return lines


def _close_together(survey: Survey) -> str:
    """On what is fixed where that is a small part of the map; empty where it is not."""
    held = [marker for marker in survey.markers if marker.fixed]
    span_m, extent_m = _span_m(held), _span_m(survey.markers)
    if not held or span_m >= _SPAN * extent_m:
        return ""
    ids = listed(marker.id for marker in held)
    who = (
        f"only marker {ids} is fixed, in a map of {extent_m:.2f} m"
        if len(held) == 1
        else f"fixed are only {ids}, {span_m:.2f} m apart in a map of {extent_m:.2f} m"
    )
    return (
        f"{who}: their errors grow with the distance from them, and are not in std_m; fix two that "
        "are far apart"
    )


def _span_m(markers: Sequence[SurveyedMarker]) -> float:
    """Between the two farthest apart, as measured by hand."""
    centres = np.array([marker.hand.centre_m for marker in markers]).reshape(-1, 3)
    return float(np.linalg.norm(centres[:, None] - centres, axis=2).max(initial=0.0))


def _reasons(count: FrameCount, survey: Survey) -> str:
    reasons = {
        "with fewer than two mapped markers": count.few_markers,
        "with fixed ones only": count.only_fixed,
        "without a pose": count.without_pose,
        "not decoded": count.undecodable,
        "from where others are": count.usable - survey.frames,
    }
    told = [f"{number} {reason}" for reason, number in reasons.items() if number]
    return f" ({', '.join(told)})" if told else ""


def listed(ids: Iterable[int]) -> str:
    return ", ".join(map(str, sorted(ids)))


def survey_json(survey: Survey, count: FrameCount, sources: Mapping[str, str]) -> dict[str, Any]:
    """Everything, in metres and degrees.

    Args:
        sources: SHA-256 by the name of each file that went in.
    """
    return {
        "sources": dict(sources),
        "frames_used": survey.frames,
        "frames": asdict(count),
        "views": survey.observations,
        "views_left_out": survey.rejected,
        "reprojection_rms_before_px": survey.rms_before_px,
        "reprojection_rms_after_px": survey.rms_after_px,
        "corner_sigma_px": survey.sigma_px,
        "edge_inset_px": survey.edge_px,
        "edge_inset_sigma_px": survey.edge_sigma_px,
        "frames_that_count_as_one": survey.correlation,
        "corner_bias_px": survey.bias_px,
        "converged": survey.converged,
        "fixed": sorted(survey.options.fix),
        "std_m": survey.options.std_m,
        "std_deg": survey.options.std_deg,
        "loss": survey.options.loss,
        "unseen": list(survey.unseen),
        "disowned": list(survey.disowned),
        "contradicted": list(survey.contradicted),
        "groups": [list(group) for group in survey.groups],
        "warnings": warnings(survey),
        "markers": [_marker_json(marker) for marker in survey.markers],
    }


def _marker_json(marker: SurveyedMarker) -> dict[str, Any]:
    free = not marker.fixed
    return {
        "id": marker.id,
        "fixed": marker.fixed,
        "views": marker.seen,
        "views_left_out": marker.rejected,
        "shift_m": marker.shift_m.tolist(),
        "turn_deg": np.degrees(marker.turn_rad).tolist(),
        "yaw_deg": math.degrees(marker.yaw_rad),
        "tilt_deg": math.degrees(marker.tilt_rad),
        "shift_sigma_m": marker.shift_sigma_m.tolist() if free else None,
        "turn_sigma_deg": np.degrees(marker.turn_sigma_rad).tolist() if free else None,
        "prior_std_m": marker.prior.std_m,
        "prior_std_deg": math.degrees(marker.prior.std_rad),
        "sigmas_from_measurement": marker.sigmas,
        "measure_again": marker.implausible,
    }


def refined_yaml(survey: Survey, sources: Mapping[str, str]) -> bytes:
    """The refined map.yaml, with where it comes from at its head.

    Args:
        sources: SHA-256 by the name of each file that went in, the map last.
    """
    options = survey.options
    *logs, (map_name, map_digest) = sources.items()
    fixed = listed(marker.id for marker in survey.markers if marker.fixed)
    lines = [
        "Marker poses refined by `arucolog map survey`.",
        *(f"log: {name} sha256:{digest}" for name, digest in logs),
        f"measured by hand: {map_name} sha256:{map_digest}",
        f"taken as known to {options.std_m:g} m, where it gives no std_m, and to "
        f"{options.std_deg:g} deg",
        f"{survey.frames} frames; corners fit to {survey.rms_after_px:.2f} px rms, before "
        f"{survey.rms_before_px:.2f} px",
        f"held as they were: {fixed or 'none'}"
        + (f"; the images contradict {listed(survey.contradicted)}" if survey.contradicted else ""),
        f"not seen, as they were: {listed((*survey.unseen, *survey.disowned)) or 'none'}",
        "std_m of the others: standard deviation of each coordinate"
        + (", relative to what was held" if fixed else ""),
        "the camera's calibration is taken as exact: its errors are not in std_m",
    ]
    markers = {m.id for m in survey.markers if not m.fixed}
    written = tuple(_rounded(m) if m.id in markers else m for m in survey.refined.markers)
    header = "".join(f"# {line}\n" for line in lines)
    return header.encode() + map_yaml(replace(survey.refined, markers=written))


def _rounded(marker: Marker) -> Marker:
    """To a micrometre, and no more digits than that is worth."""
    pose = marker.T_map_marker
    T_map_marker = Pose.from_quat(pose.translation.round(6), pose.quat_xyzw.round(8))
    std_m = None if marker.std_m is None else max(round(marker.std_m, 6), 1e-6)
    return Marker.from_pose(marker.id, T_map_marker, marker.size_m, std_m, marker.tags)
