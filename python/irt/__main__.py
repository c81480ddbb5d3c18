"""`python -m irt`: the command line, where the script `irt` is not on the path."""

import sys

from irt.cli.__main__ import main

if __name__ == "__main__":
    sys.exit(main())
