"""The progress bar of all verbs."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

#: Delay before the bar is shown [s].
_PATIENCE_S = 2.0


@contextmanager
def progress_bar() -> Iterator[Callable[[int, int, str], None]]:
    """Yield a function to call with (done, total, text) as the work proceeds.

    It draws a bar on standard error, after two seconds and only on a terminal. The bar is cleared at the end.
    """
    from tqdm import tqdm

    with tqdm(file=sys.stderr, disable=None, delay=_PATIENCE_S, leave=False, dynamic_ncols=True) as bar:

        def update(done: int, total: int, text: str) -> None:
            bar.total = total
            bar.set_description_str(text, refresh=False)
            bar.update(done - bar.n)

        yield update
