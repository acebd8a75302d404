"""Every finding, in the order of the paper."""

from __future__ import annotations

from analysis.paper.experiments import Experiments
from analysis.paper.findings.counts import count_findings
from analysis.paper.findings.finding import Finding
from analysis.paper.findings.placement import placement_findings
from analysis.paper.findings.tracking import tracking_findings


def all_findings(runs: Experiments) -> list[Finding]:
    """Placement, number of markers, tracking."""
    return [*placement_findings(runs), *count_findings(runs), *tracking_findings(runs)]
