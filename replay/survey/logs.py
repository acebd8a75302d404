"""A survey of logs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path

from pipeline.camera import Camera
from pipeline.detection import ArucoDetection, CornerRefinement
from pipeline.localizer import PipelineSettings
from pipeline.markers import MarkerMap
from recorder.errors import InputError
from recorder.log.reader import LogReader
from replay.inputs import Inputs, Overrides, gather
from replay.survey.problem import ANY_EDGES, EdgePrior
from replay.survey.results import Survey, SurveyOptions
from replay.survey.sightings import FrameCount, Sighter, Sighting, Span, read_sightings
from replay.survey.survey import survey

# Measured on rendered drives with two markers fixed, whose distance tells the inset to 0.005 px;
# real prints, exposures and lenses have shown up to 0.2 px less.
_EDGES: dict[CornerRefinement, EdgePrior] = {
    "contour": EdgePrior(0.49, 0.1),
    "subpix": EdgePrior(0.18, 0.1),
}


@dataclass(frozen=True, eq=False)
class SurveyedLogs:
    """Attributes:
    sources: SHA-256 by the name of each file that went in, the map last; by its path where
        another has the same name.
    cut_short: why a log ends before its end, by the same names.
    """

    survey: Survey
    count: FrameCount
    sources: dict[str, str]
    cut_short: dict[str, str]


def survey_logs(
    logs: Sequence[Path],
    camera: Path | None,
    marker_map: Path | None,
    settings: PipelineSettings,
    options: SurveyOptions,
    span: Span,
    *,
    on_step: Callable[[str], None] = lambda _: None,
) -> SurveyedLogs:
    """Refines a map from logs of one camera; the files given take the place of the first log's.

    What `options` says of edges gives way to what is known of the detector.

    Raises:
        InputError: a log or file is not what it should be, the logs are of different cameras, or
            they say nothing about the map, or it is not the map of what they show.
    """
    inputs: Inputs | None = None
    sighter: Sighter | None = None
    sightings: list[Sighting] = []
    sources: dict[str, str] = {}
    cut_short: dict[str, str] = {}
    named = Counter(log.name for log in logs)
    for number, log in enumerate(logs):
        label = log.name if named[log.name] == 1 else str(log)
        with LogReader(log) as reader:
            if inputs is None or sighter is None:
                inputs = gather(reader, Overrides(camera, marker_map))
                place = marker_map or log
                unknown = sorted(options.fix - set(inputs.marker_map.ids))
                if unknown:
                    found = ", ".join(map(str, unknown))
                    raise InputError(place, f"expected the markers to fix, found no {found}")
                sighter = Sighter(inputs.camera, inputs.marker_map, options.fix, settings.pose)
            elif camera is None:
                _check_same(log, inputs.camera, reader.camera())
            sightings += read_sightings(
                reader,
                number,
                inputs.camera,
                inputs.marker_map,
                settings.detector,
                sighter,
                span,
            )
            sources[label] = reader.sha256()
            if reader.shortfall:
                cut_short[label] = reader.shortfall
    if inputs is None or sighter is None:
        raise ValueError("expected a log, found none")
    name = marker_map.name if marker_map else f"map.yaml of {logs[0].name}"
    sources[name] = sha256(inputs.files["map.yaml"]).hexdigest()
    _check_poses(place, sighter.count)
    options = replace(options, edges=expected_edges(settings.detector, inputs.marker_map))
    try:
        done = survey(sightings, inputs.camera, inputs.marker_map, options, on_step=on_step)
    except ValueError as error:
        count = sighter.count
        seen = (
            f" ({count.read} images: {count.undecodable} undecodable or of another size than the "
            f"calibration's, {count.few_markers} with fewer than two mapped markers, "
            f"{count.only_fixed} with fixed markers only, {count.without_pose} without a pose)"
        )
        raise InputError(logs[0], f"{error}{seen}") from error
    return SurveyedLogs(done, sighter.count, sources, cut_short)


def expected_edges(detector: ArucoDetection, marker_map: MarkerMap) -> EdgePrior:
    """What the detector is expected to do to edges; to white markers on black the reverse."""
    edges = _EDGES.get(detector.corner_refinement, ANY_EDGES)
    return replace(edges, mean_px=-edges.mean_px) if marker_map.inverted else edges


def _check_poses(place: Path, count: FrameCount) -> None:
    """The map is so much like the place that most frames have a pose in it.

    Markers of a ceiling that are 20 cm off still give 9 of 10 frames one.

    Raises:
        InputError: most have none.
    """
    if count.without_pose > count.usable:
        raise InputError(
            place,
            "expected a map in which most images that see two of its markers have a pose, found "
            f"{count.without_pose} of {count.without_pose + count.usable} without one: is it of "
            "this place, and the calibration this camera's?",
        )


def _check_same(log: Path, expected: Camera, found: Camera | None) -> None:
    """The logs are of one camera.

    Raises:
        InputError: they are not; a log without a calibration is as good as any.
    """
    if found is None:
        return
    same = (
        expected.image_size == found.image_size
        and expected.distortion_model == found.distortion_model
        and expected.camera_matrix.tolist() == found.camera_matrix.tolist()
        and expected.dist_coeffs.tolist() == found.dist_coeffs.tolist()
    )
    if not same:
        raise InputError(
            log, "expected the first log's calibration, found another (--camera gives one for all)"
        )
