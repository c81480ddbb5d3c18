"""Pictures and pages: what a fit found, to be looked at."""
