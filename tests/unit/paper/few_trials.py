"""The methods that are tried in tests: all but sbi's, whose training takes longer than all the rest."""

from irt.paper.contenders import METHODS

QUICK = tuple(name for name in METHODS if name != "npe")
