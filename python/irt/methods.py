"""The methods of tuning. A module of its own: the command line lists them without loading any."""

from __future__ import annotations

#: Title of each in text, in the order in which help lists them; the first is the default.
TITLES = {
    "least-squares": "least squares",
    "irt+": "IRT+",
    "irt": "IRT",
    "cma-es": "CMA-ES",
    "es": "the (5+100) evolution strategy",
    "direct": "direct prediction",
}
METHODS = tuple(TITLES)
#: Which methods an option belongs to that not all have.
BELONGS = {
    "starts": METHODS[:-1],
    "iterations": ("irt",),
    "rollouts": ("irt+", "cma-es", "es"),
    "network": ("irt+", "irt", "direct"),
    "effects": ("least-squares",),
}
