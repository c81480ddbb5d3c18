"""Names of the tuning methods, in a separate module so that the command line need not load the methods."""

from __future__ import annotations

#: Title of each method, in the order of the help; the first is the default.
TITLES = {
    "least-squares": "least squares",
    "irt+": "IRT+",
    "irt": "IRT",
    "cma-es": "CMA-ES",
    "es": "the (5+100) evolution strategy",
    "direct": "direct prediction",
}
METHODS = tuple(TITLES)
#: Methods of each option that not all methods have.
BELONGS = {
    "starts": METHODS[:-1],
    "iterations": ("irt",),
    "rollouts": ("irt+", "cma-es", "es"),
    "network": ("irt+", "irt", "direct"),
    "effects": ("least-squares",),
}
