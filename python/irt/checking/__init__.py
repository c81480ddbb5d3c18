"""Before a fit: what is in a rig's recordings, whether it can be right, and what it could identify."""

from irt.check.identify import SHOWS
from irt.check.result import Check, Detectable, Finding, Identified, ResponseFacts, RunFacts, SignalFacts
from irt.check.run import check
from irt.check.text import page

__all__ = [
    "SHOWS",
    "Check",
    "Detectable",
    "Finding",
    "Identified",
    "ResponseFacts",
    "RunFacts",
    "SignalFacts",
    "check",
    "page",
]
