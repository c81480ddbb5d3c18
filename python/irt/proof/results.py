"""All scores of a proof, and their file ``scores.json``."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from irt.files import read_json, write_atomic
from irt.proof.contest import METHODS
from irt.proof.contested import Contestant, Standing, contestants, is_ahead, of_diagnosis, standing
from irt.proof.further import Resolved, all_resolved
from irt.proof.hash_chain import Places
from irt.proof.metrics import Floor, floors
from irt.proof.plan import Plan
from irt.proof.provenance import this_code
from irt.proof.score import RigScore, score_rig
from irt.proof.seal import canonical


@dataclass(frozen=True)
class Results:
    """The scores of a proof.

    Attributes
    ----------
    scores : tuple of RigScore
        One for each rig.
    entries : tuple of Contestant
        Scores of other methods on the same rigs; empty if they did not run.
    ties : tuple of Resolved
        Ties before and after one more run; empty without ties.
    provenance : dict
        ``world``, ``code``, ``commit`` and ``seed``, and ``scorer``, the code that scored.
    """

    scores: tuple[RigScore, ...]
    entries: tuple[Contestant, ...] = ()
    ties: tuple[Resolved, ...] = ()
    provenance: dict[str, str] = field(default_factory=dict)

    @classmethod
    def of(cls, places: Places) -> Results:
        """Score a proof whose seals are open.

        Raises
        ------
        IrtError
            If a file is missing or broken.
        """
        published, keys = read_json(places.plan), read_json(places.keys)
        names = Plan(**published["plan"]).names()
        scores = tuple(score_rig(name, places.answer(name), places.opened(name)) for name in names)
        entries = [
            entry
            for score in scores
            if places.contest(score.rig).exists()
            for entry in contestants(
                score, places.contest(score.rig), places.opened(score.rig), places.start(score.rig)
            )
        ]
        ties = tuple(all_resolved(scores, places.out / "further"))
        provenance = {name: str(published[name]) for name in ("world", "code", "commit")}
        provenance.update(seed=str(keys["seed"]), scorer=this_code())
        return cls(scores, tuple(entries), ties, provenance)

    @property
    def standings(self) -> list[Standing]:
        """Scores of all methods, the diagnosis first."""
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
        found = floors(self.scores)
        if not others or ours.named is None:
            return found
        share, (low, high) = ours.named.share, ours.named.interval
        kept = is_ahead(ours, others)
        promise = "more named, and a smaller held-out error"
        return [*found, Floor("ahead of every other method", promise, share, low, high, ours.named.of, kept)]

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
            "provenance": self.provenance,
        }
        write_atomic(path, canonical(content) + b"\n")
