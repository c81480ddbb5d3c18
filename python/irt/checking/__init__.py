"""Before a fit: what is in a rig's recordings, whether it can be right, and what it could identify."""

from irt.checking.identify import SHOWS
from irt.checking.result import Check, Detectable, Finding, Identified, ResponseFacts, RunFacts, SignalFacts
from irt.checking.run import check
from irt.checking.text import page

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
