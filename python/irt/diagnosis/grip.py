"""How well the marble grips the board: nobody measures it, and it shows for milliseconds after an impact."""

from __future__ import annotations

from dataclasses import replace

from irt.diagnosis.case import Case, Fitted
from irt.rig import Board

#: Coefficients of friction beside the rig's own: one that no impact overcomes.
OTHERS = (1000.0,)
#: Grips whose likelihood is within so many nats of the best are all possible.
POSSIBLE = 3.0


def grips(case: Case, best: Fitted) -> list[tuple[Case, Fitted]]:
    """Refit a hypothesis with other grips, where the rig does not say how well its marble grips.

    Returns
    -------
    list of (Case, Fitted)
        Those that the recordings allow, the likeliest first; the rig's own first among equals.
    """
    tried = [(case, best)]
    if case.rig.board.sliding_friction == Board.sliding_friction:
        for grip in OTHERS:
            board = replace(case.rig.board, sliding_friction=grip)
            other = replace(case, rig=replace(case.rig, board=board))
            fitted = other.fit(best.effects, points=best.values[None], rounds=1)
            tried.append((other, fitted))
    scale = max(case.noise, min(one.noise for _, one in tried))
    losses = [one.loss(scale) for _, one in tried]
    # The rig's own grip stays, unless another is clearly likelier; so does that of the model it came with.
    if not best.effects or min(losses) > losses[0] - POSSIBLE:
        order = [0, *sorted(range(1, len(tried)), key=lambda i: losses[i])]
    else:
        order = sorted(range(len(tried)), key=lambda i: losses[i])
    first = losses[order[0]]
    return [tried[i] for i in order if losses[i] < first + POSSIBLE]
