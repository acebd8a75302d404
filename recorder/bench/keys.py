"""From single keys to marks: numbers are typed, letters act at once."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Literal

from recorder.bench.marking import Marking
from recorder.files.truth_entries import check_name

KEYS = "keys: 3 Enter at 3, n next, p previous, w name, s still, u undo, t note, ? help"
HELP = """\
  NUMBER Enter  arrived at that waypoint; w NAME Enter: the same by name
  n, p          arrived at the next, the previous waypoint
  s             stands still there from now on; again, before it moves: until now
  u             take the last mark back
  t TEXT Enter  a note
  Ctrl-C        end the recording"""

_ENTER, _ESCAPE, _BACKSPACE = "\r\n", "\x1b", "\x7f\b"
# Arrow keys and the like come as several characters that are no keys of ours.
_SEQUENCE = re.compile(r"\x1b(?:\[[0-9;?]*[ -/]*[@-~]|O.)")
_LONGEST = {"waypoint": 20, "note": 200}


class KeyInput:
    """Understands what is typed, a few characters at a time.

    Attributes:
        entry: what is being typed, with its kind; None where keys act at once.
    """

    def __init__(self, marking: Marking) -> None:
        self._marking = marking
        self.entry: tuple[Literal["waypoint", "note"], str] | None = None

    def feed(self, text: str, system_ns: int) -> Iterator[str]:
        """Takes characters that came at `system_ns`; yields what to say about them."""
        for character in _SEQUENCE.sub("", text):
            key = self._typed if self.entry is not None else self._pressed
            if said := key(character, system_ns):
                yield said

    def _pressed(self, key: str, system_ns: int) -> str | None:
        marking = self._marking
        match key.lower():
            case "n":
                return marking.step(1, system_ns)
            case "p":
                return marking.step(-1, system_ns)
            case "s":
                return marking.toggle_standing(system_ns)
            case "u":
                return marking.undo(system_ns)
            case "w":
                self.entry = ("waypoint", "")
            case "t":
                self.entry = ("note", "")
            case "?" | "h":
                return HELP
            case digit if digit.isascii() and digit.isdecimal():
                self.entry = ("waypoint", digit)
            case letter if letter.isprintable() and not letter.isspace():
                return f"{key} is no key, ? shows them"
        return None

    def _typed(self, key: str, system_ns: int) -> str | None:
        if self.entry is None:
            return None
        kind, text = self.entry
        if key in _ENTER:
            self.entry = None
            return self._entered(kind, text.strip(), system_ns)
        if key == _ESCAPE:
            self.entry = None
        elif key in _BACKSPACE:
            self.entry = (kind, text[:-1]) if text else None
        elif key.isprintable() and len(text) < _LONGEST[kind]:
            self.entry = (kind, text + key)
        return None

    def _entered(self, kind: str, text: str, system_ns: int) -> str | None:
        if not text:
            return None
        if kind == "note":
            return self._marking.note(text, system_ns)
        try:
            return self._marking.arrived(check_name(text), system_ns)
        except ValueError as error:
            return str(error)
