"""The one error for files and logs that people give us."""

from __future__ import annotations

from os import PathLike


class InputError(Exception):
    """A file that is not what was expected; its text is one line that says what to do.

    Args:
        path: the file.
        problem: what was expected and what was found, in one line.
        where: the key, topic or record inside the file, where there is one.
    """

    def __init__(self, path: str | PathLike[str], problem: str, where: str | None = None) -> None:
        self.path = str(path)
        self.where = where
        self.problem = problem
        place = f"{self.path}: {where}" if where else self.path
        super().__init__(" ".join(f"{place}: {problem}".split()))
