"""A source that is another one but for its frames."""

from __future__ import annotations

from collections.abc import Mapping

from recorder.sources.base import Source


class WrappedSource:
    """Everything as of `source`; whoever derives from it says what becomes of the frames."""

    def __init__(self, source: Source) -> None:
        self._source = source
        self.name = source.name

    def describe(self) -> dict[str, str]:
        return self._source.describe()

    @property
    def attachments(self) -> Mapping[str, bytes]:
        return self._source.attachments

    @property
    def image_size(self) -> tuple[int, int]:
        return self._source.image_size

    def frame_count(self) -> int | None:
        return self._source.frame_count()

    def preparation(self) -> str | None:
        return self._source.preparation()
