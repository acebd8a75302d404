"""The simulated camera as a source of frames."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Generator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from recorder.simulation.scene_file import Scene, load_scene
from recorder.sources.base import CapturedFrame, SourceEvent

if TYPE_CHECKING:
    from recorder.simulation.renderer import Renderer


class SceneSource:
    """Renders the frames of a scene.yaml; the same scene gives the same bytes.

    The capture stamp and the exact pose of a frame are those of mid-exposure.

    Args:
        workers: threads that render ahead, each one frame; None: two at most.

    Raises:
        InputError: the scene is not what was expected.
    """

    def __init__(self, path: Path, workers: int | None = None) -> None:
        self.scene: Scene = load_scene(path)
        self.name = path.stem
        self._workers = workers or min(2, os.cpu_count() or 1)

    def describe(self) -> dict[str, str]:
        """Kind, file, digest and settings."""
        file = self.scene.file
        return {
            "kind": "simulation",
            "name": self.scene.path.name,
            "sha256": self.scene.sha256,
            "seed": str(file.seed),
            "rate_hz": str(file.rate_hz),
            "frames": str(len(self._numbers)),
            "encoding": file.image.encoding,
            "jpeg_quality": str(file.image.jpeg_quality),
            "note": file.note,
        }

    @property
    def attachments(self) -> Mapping[str, bytes]:
        """camera.yaml, map.yaml and truth.yaml as the log is told."""
        return self.scene.attachments

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.scene.camera.image_size

    def frame_count(self) -> int | None:
        return len(self._numbers)

    def preparation(self) -> str | None:
        from recorder.simulation.renderer import is_compiled

        return None if is_compiled() else "compiling the renderer, which takes a while, once"

    @cached_property
    def _numbers(self) -> list[int]:
        """The frames that the camera does not lose."""
        lost = set(self.scene.file.dropped_frames)
        return [i for i in range(self.scene.frame_count) if i not in lost]

    def frames(self) -> Generator[CapturedFrame | SourceEvent]:
        """The frames in order, and the scene's events between them; a few are rendered ahead."""
        events = deque(self.scene.events())
        for frame in self._rendered():
            while events and events[0].timestamp_ns <= frame.timestamp_ns:
                yield events.popleft()
            yield frame
        yield from events

    def _rendered(self) -> Generator[CapturedFrame]:
        renderer = self.renderer()
        pool = ThreadPoolExecutor(self._workers, thread_name_prefix="render")
        ahead: deque[Future[CapturedFrame]] = deque()
        try:
            for index in self._numbers:
                ahead.append(pool.submit(self.render, renderer, index))
                if len(ahead) > self._workers:
                    yield ahead.popleft().result()
            while ahead:
                yield ahead.popleft().result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)

    def renderer(self) -> Renderer:
        """The renderer of the true scene."""
        from recorder.simulation.renderer import Renderer

        file = self.scene.file
        return Renderer(
            self.scene.true_camera,
            self.scene.quads(),
            file.surface,
            file.lamps,
            file.image,
            file.seed,
        )

    def render(self, renderer: Renderer, index: int) -> CapturedFrame:
        """One frame, by its number."""
        from recorder.simulation.encoding import encode

        t_s = self.scene.time_s(index)
        image = renderer.capture(lambda dt_s: self.scene.pose(t_s + dt_s), index)
        stamp_ns = self.scene.timestamp_ns(index)
        settings = renderer.image
        return CapturedFrame(
            frame_index=index,
            timestamp_ns=stamp_ns,
            arrival_ns=stamp_ns,
            data=encode(image, settings.encoding, settings.jpeg_quality),
            format=settings.encoding,
            T_map_camera=self.scene.pose(t_s),
        )
