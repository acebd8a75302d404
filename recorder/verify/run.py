"""All rules on a log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from recorder.verify import content_rules, file_rules, time_rules
from recorder.verify.facts import Facts, gather
from recorder.verify.verdict import LogVerdict, Verdict

RULES: tuple[Callable[[Facts], Verdict], ...] = (
    file_rules.end,
    file_rules.parts,
    file_rules.checksums,
    file_rules.index,
    file_rules.counts,
    time_rules.gaps,
    time_rules.stamps,
    time_rules.rate,
    time_rules.arrivals,
    content_rules.images,
    content_rules.calibration,
    content_rules.marker_map,
    content_rules.truth,
)


def verify(
    paths: Sequence[Path], *, decode: bool = True, on_image: Callable[[], object] = lambda: None
) -> LogVerdict:
    """What every rule says of one recording.

    Args:
        paths: a log, or the parts of a recording in their order.
        decode: look into every image, not only at its header and end.
        on_image: called for each image, to show progress.

    Raises:
        InputError: not a log.
    """
    facts = gather(paths, decode=decode, on_image=on_image)
    return LogVerdict(tuple(map(str, paths)), tuple(rule(facts) for rule in RULES))


def verdict_text(verdict: LogVerdict) -> str:
    """For people: a line per rule, and the verdict."""
    log = verdict.logs[0]
    if len(verdict.logs) > 1:
        log += f" to {Path(verdict.logs[-1]).name}"
    width = max(len(rule.rule) for rule in verdict.rules)
    lines = [f"  {rule.level:<8} {rule.rule:<{width}}  {rule.text}" for rule in verdict.rules]
    found = []
    if verdict.count("failed"):
        found.append(f"{verdict.count('failed')} of {len(verdict.rules)} rules failed")
    if n := verdict.count("warning"):
        found.append("1 warning" if n == 1 else f"{n} warnings")
    end = "failed" if verdict.level == "failed" else "ok"
    return "\n".join([f"{log}: {end}" + (f" ({', '.join(found)})" if found else ""), *lines])
