"""The scorecard of a proof: a Markdown page with its figures in a folder beside it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from irt.files import make_folder, write_atomic
from irt.proof import figures, found
from irt.proof.calibrated import budgets, calibrated, listed
from irt.proof.failures import failures, short_unread
from irt.proof.hash_chain import CHAIN, Places
from irt.proof.metrics import nulls, of_catalogue
from irt.proof.plan import FULL
from irt.proof.results import Results
from irt.proof.seal import digest
from irt.proof.wording import counted, header, kept, measured, row


def write_scorecard(
    page: Path, results: Results, places: Places, settings: Mapping[str, str], *, publish: bool = False
) -> Path:
    """Write the page, its pictures and ``scores.json``, the latter two into a folder of the page's name.

    Parameters
    ----------
    page : Path
        The ``.md`` file.
    results : Results
        The scores.
    places : Places
        The finished proof, whose hashes the page lists.
    settings : mapping
        Descriptions of the settings, by title.
    publish : bool
        Whether plan, commitments, manifest and keys are copied beside the page.

    Raises
    ------
    IrtError
        If something cannot be written.
    """
    make_folder(page.parent)
    folder = make_folder(page.with_suffix(""))
    chain = [places.out / name for name in CHAIN]
    if publish and folder.resolve() != places.out.resolve():
        for path in chain:
            write_atomic(folder / path.name, path.read_bytes())
    scores = results.scores
    figures.plot_confusion(folder / "confusion.png", scores)
    figures.plot_power(folder / "power.png", scores)
    figures.plot_gaps(folder / "gaps.png", scores, list(_rival_gaps(results)))
    figures.plot_coverage(folder / "coverage.png", scores)
    figures.plot_reliability(folder / "reliability.png", listed(scores))
    figures.plot_budget(folder / "budget.png", budgets(scores))
    results.save(folder / "scores.json")
    lines = [
        *_answer(results),
        *found.named(scores, folder.name),
        *failures(scores),
        *found.held_out_runs(results, folder.name),
        *found.methods(results),
        *found.one_more_run(results),
        *calibrated(scores, folder.name),
        *_files({**settings, **_made(results)}, chain),
        "",
        f"Every score is in [{folder.name}/scores.json]({folder.name}/scores.json).",
    ]
    write_atomic(page, "\n".join(lines) + "\n")
    return page


def verdict(results: Results) -> str:
    """Return the result of a proof in one or two sentences."""
    promises = [one for one in results.floors if one.kept is not None]
    kept = sum(bool(one.kept) for one in promises)
    hidden, quiet = _sizes(results)
    short = [one.what for one in promises if not one.kept and one.sure]
    perhaps = [one.what for one in promises if not one.kept and not one.sure]
    sentence = (
        f"{counted(hidden, 'rig')} with hidden physics and {quiet} without, "
        f"diagnosed blind: {kept} of {len(promises)} promises kept."
    )
    if short:
        sentence += f" Missed: {'; '.join(short)}."
    if perhaps:
        sentence += f" Missed, though not with 95 % confidence: {'; '.join(perhaps)}."
    return sentence + short_unread(results.scores)


def _answer(results: Results) -> Iterator[str]:
    yield "# Proof by concealment"
    yield ""
    recorded = results.provenance.get("world", "in a separate process")
    yield (
        "The list of rigs, the code that diagnoses them and a commitment to a secret seed, which decides "
        "what each rig hides, were written down first. Then another program recorded every rig "
        f"({recorded}), and the SHA-256 of all recordings and commitments to all labels were added. Each rig "
        "was diagnosed by a process that got a copy of its recordings alone. The SHA-256 of every answer was "
        "written down before seed and labels were released. `irt prove --verify` checks plan, commitments, "
        "answers and labels against each other ([files](#files))."
    )
    yield ""
    hidden, quiet = _sizes(results)
    if hidden < FULL[0] or quiet < FULL[1]:
        yield (
            f"With {hidden} rigs with hidden physics and {quiet} without, this proof is smaller than the "
            f"full proof of {FULL[0]} and {FULL[1]}; the intervals say what so few rigs leave open."
        )
        yield ""
    yield f"**{verdict(results)}**"
    yield ""
    yield from header(["promise", "floor", "measured (95 % interval)", "of", "kept"])
    for one in results.floors:
        yield row([one.what, one.promise, measured(one), f"{one.of}", kept(one)])
    yield ""
    yield "Rates have Wilson intervals, their differences Newcombe's, medians bootstrap intervals."


def _sizes(results: Results) -> tuple[int, int]:
    """Return the numbers of rigs with and without hidden physics."""
    quiet = len(nulls(results.scores))
    return len(results.scores) - quiet, quiet


def _files(settings: Mapping[str, str], chain: Sequence[Path]) -> Iterator[str]:
    yield "\n## Files\n"
    yield (
        "`plan.json` has the list of rigs, the code and the commitment to the seed, and was written before "
        "the first rig. `commitments.json`, written before the first diagnosis, has the SHA-256 of each "
        "recording and the commitment to each label: the SHA-256 of a secret nonce, the name of the rig and "
        "its label. `manifest.json`, written after the last diagnosis, has the SHA-256 of each answer. "
        "`keys.json` has seed and nonce. Each file has the SHA-256 of the one before it.\n"
    )
    yield from header(["", ""])
    for title, words in settings.items():
        yield row([title, words])
    yield ""
    yield from header(["file", "SHA-256"])
    for path in chain:
        yield row([f"`{path.name}`", f"`{digest(path.read_bytes())}`"])


def _made(results: Results) -> dict[str, str]:
    titles = {
        "world": "recorded by",
        "code": "diagnosed by",
        "commit": "commit",
        "seed": "seed",
        "scorer": "scored by",
    }
    made = {title: results.provenance[name] for name, title in titles.items() if results.provenance.get(name)}
    if made.get("scored by") == made.get("diagnosed by"):
        made.pop("scored by", None)
    return made


def _rival_gaps(results: Results) -> Iterator[tuple[str, list[float]]]:
    """Yield the share of the gap that each other method closes in the rigs that count."""
    known = {one.rig: one for one in of_catalogue(results.scores) if one.closed is not None}
    for name, title in (
        ("single", "best single effect"),
        ("gaussian", "Gaussian process"),
        ("neural", "neural network"),
        ("sysid", "mujoco.sysid"),
        ("sindy", "PySINDy"),
    ):
        closed = []
        for one in results.entries:
            errors = known[one.rig].errors if one.rig in known else None
            if one.method == name and one.error is not None and errors is not None:
                closed.append(errors.closed(one.error) or 0.0)
        yield title, closed
