"""`irt check`: facts about recordings, implausible data, and identifiability, before a fit."""

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
