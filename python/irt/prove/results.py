"""All scores of a proof, from its folder to ``scores.json``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from irt.files import write_atomic
from irt.prove.chain import Places
from irt.prove.contest import METHODS
from irt.prove.contested import Contestant, Standing, contestants, is_ahead, of_diagnosis, standing
from irt.prove.further import Resolved, all_resolved
from irt.prove.score import RigScore, score_rig
from irt.prove.seal import canonical
from irt.prove.tally import Floor, floors


@dataclass(frozen=True)
class Results:
    """The scores of a proof.

    Attributes
    ----------
    scores : tuple of RigScore
        One for each rig.
    entries : tuple of Contestant
        What other methods made of the same rigs; empty where they were not asked.
    ties : tuple of Resolved
        What became of ties with one run more; empty where there were none.
    """

    scores: tuple[RigScore, ...]
    entries: tuple[Contestant, ...] = ()
    ties: tuple[Resolved, ...] = ()

    @classmethod
    def of(cls, places: Places, names: Sequence[str]) -> Results:
        """Score a proof whose seals are open.

        Raises
        ------
        IrtError
            If a file is missing or broken.
        """
        scores = tuple(score_rig(name, places.answer(name), places.opened(name)) for name in names)
        entries = [
            entry
            for score in scores
            if places.contest(score.rig).exists()
            for entry in contestants(
                score, places.contest(score.rig), places.opened(score.rig), places.start(score.rig)
            )
        ]
        return cls(scores, tuple(entries), tuple(all_resolved(scores, places.out / "further")))

    @classmethod
    def joined(cls, rounds: Sequence[Results]) -> Results:
        """Return the scores of several rounds as those of one proof; no two rigs share a name."""
        return cls(
            tuple(one for each in rounds for one in each.scores),
            tuple(one for each in rounds for one in each.entries),
            tuple(one for each in rounds for one in each.ties),
        )

    @property
    def standings(self) -> list[Standing]:
        """How each method did, the diagnosis first."""
        ours = standing("irt diagnose", self.scores, [of_diagnosis(one) for one in self.scores])
        others = [
            standing(title, self.scores, [one for one in self.entries if one.method == name])
            for name, (title, _) in METHODS.items()
            if self.entries
        ]
        return [ours, *others]

    @property
    def floors(self) -> list[Floor]:
        """The promises, and whether they are kept."""
        ours, *others = self.standings
        told = floors(self.scores)
        if not others or ours.named is None:
            return told
        share, (low, high) = ours.named.share, ours.named.interval
        kept = is_ahead(ours, others)
        promise = "more named, and a smaller held-out error"
        return [*told, Floor("ahead of every other method", promise, share, low, high, ours.named.of, kept)]

    def save(self, path: Path) -> None:
        """Write every score of every rig as JSON.

        Raises
        ------
        IrtError
            If the file cannot be written.
        """
        content: dict[str, Any] = {
            "rigs": [one.as_dict() for one in self.scores],
            "baselines": [one.as_dict() for one in self.entries],
            "ties": [asdict(one) for one in self.ties],
        }
        write_atomic(path, canonical(content) + b"\n")
