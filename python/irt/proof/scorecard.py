"""The scorecard of a proof: a Markdown page with its figures in a folder beside it."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from irt.diagnosis.result import UNLISTED
from irt.files import make_folder, write_atomic
from irt.proof import figures
from irt.proof.failures import GROUPS, counted, failures, left_out_runs, short_unread, unread_rigs
from irt.proof.further import KINDS
from irt.proof.hash_chain import CHAIN, Places
from irt.proof.metrics import (
    CLEAR,
    GAP_CLOSED,
    Floor,
    Quantity,
    Rate,
    coverage,
    gaps,
    in_group,
    is_clear,
    nulls,
    of_catalogue,
    power,
)
from irt.proof.plan import NULLS
from irt.proof.results import Results
from irt.proof.score import CHANCE, RigScore
from irt.proof.seal import digest
from irt.rig import Board

#: The paper's board, for noise in millimetres.
_EDGE_MM = 1e3 * Board.edge_x_m
_NOISES_MM = (0.0, 0.3, 0.6, 1.0, 2.5)


def write_scorecard(
    page: Path, results: Results, places: Places, settings: Mapping[str, str], *, raw: bool = False
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
    raw : bool
        Whether plan, commitments, manifest and keys are copied beside the page.

    Raises
    ------
    IrtError
        If something cannot be written.
    """
    make_folder(page.parent)
    folder = make_folder(page.with_suffix(""))
    chain = [places.out / name for name in CHAIN]
    if raw and folder.resolve() != places.out.resolve():
        for path in chain:
            write_atomic(folder / path.name, path.read_bytes())
    scores = results.scores
    figures.plot_confusion(folder / "confusion.png", scores)
    figures.plot_power(folder / "power.png", scores)
    figures.plot_gaps(folder / "gaps.png", scores, list(_rival_gaps(results)))
    figures.plot_coverage(folder / "coverage.png", scores)
    results.save(folder / "scores.json")
    lines = [
        *_answer(results),
        *_naming(scores, folder.name),
        *_errors(results, folder.name),
        *_methods(results),
        *_one_more(results),
        *_intervals(scores, folder.name),
        *failures(scores),
        *_how({**settings, **_made(results)}),
        *_hashes(chain),
        "",
        f"Every score is in [{folder.name}/scores.json]({folder.name}/scores.json).",
    ]
    write_atomic(page, "\n".join(lines) + "\n")
    return page


def verdict(results: Results) -> str:
    """Return the result of a proof in one or two sentences."""
    promises = [one for one in results.floors if one.kept is not None]
    kept = sum(bool(one.kept) for one in promises)
    scores = results.scores
    hidden = len(scores) - len(nulls(scores))
    short = [one.what for one in promises if not one.kept and one.sure]
    perhaps = [one.what for one in promises if not one.kept and not one.sure]
    sentence = (
        f"{counted(hidden, 'rig')} with hidden physics and {len(scores) - hidden} without, "
        f"diagnosed blind: {kept} of {len(promises)} promises kept."
    )
    if short:
        sentence += f" Missed: {'; '.join(short)}."
    if perhaps:
        sentence += f" Missed, though not with 95 % confidence: {'; '.join(perhaps)}."
    return sentence + short_unread(scores)


def _answer(results: Results) -> Iterator[str]:
    yield "# Proof by concealment"
    yield ""
    yield f"**{verdict(results)}**"
    yield ""
    yield "| promise | floor | measured (95 % interval) | of | kept |"
    yield "| --- | --- | --- | --- | --- |"
    for one in results.floors:
        yield f"| {one.what} | {one.promise} | {_measured(one)} | {one.of} | {_kept(one)} |"
    yield ""
    yield (
        "Another engine made the recordings, and another process chose the physics to hide in them. The "
        "diagnosis saw only the recordings. The labels were sealed before it began, and opened after its "
        "last answer was written ([how](#how-it-was-done)). Rates have Wilson intervals, medians bootstrap "
        "intervals."
    )


def _naming(scores: Sequence[RigScore], folder: str) -> Iterator[str]:
    yield "\n## What was named\n"
    yield (
        f"| hidden | rigs | right | exactly | right where the signal is {CLEAR:g} times the noise "
        "| tie size | failed |"
    )
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    for group, words in GROUPS.items():
        inside = in_group(scores, group)
        if inside:
            sizes = [one.tie_size for one in inside if one.tie_size and group not in NULLS]
            size = f"{np.mean(sizes):.2f}" if sizes else ""
            failed = sum(one.verdict == "failed" for one in inside)
            right, exact = (
                _rate(Rate.over(inside, lambda one: one.found)),
                _rate(Rate.over(inside, lambda one: one.exact)),
            )
            clear = [one for one in inside if group not in NULLS and is_clear(one)]
            at_clear = f"{_rate(Rate.over(clear, lambda one: one.found))} of {len(clear)}" if clear else ""
            yield f"| {words} | {len(inside)} | {right} | {exact} | {at_clear} | {size} | {failed} |"
    yield ""
    yield (
        "An answer is right if it names the hidden effect, or declares a tie that contains it, and nothing "
        "else; if it is `unlisted` for physics that is not in the catalogue; and `sufficient` if nothing was "
        "hidden."
    )
    yield from unread_rigs(scores)
    yield "\n| of rigs with effects of the catalogue | rigs | right |"
    yield "| --- | --- | --- |"
    for words, inside in _cuts(of_catalogue(scores)):
        yield f"| {words} | {len(inside)} | {_rate(Rate.over(inside, lambda one: one.found))} |"
    yield ""
    yield from _picture(
        folder,
        "confusion",
        "Hidden effects by row, named effects by column; numbers are rigs, colours shares of the row. A tie "
        "that contains the truth counts as the truth. The last row holds names for which nothing was hidden.",
    )
    yield from _picture(
        folder,
        "power",
        "Share of rigs in which the hidden effects were named, against the distance of the refitted base "
        f"model from the true path. From {CLEAR:g} times the noise on, 90 % are promised.",
    )
    yield "| signal over noise | rigs | named, or in a tie |"
    yield "| --- | --- | --- |"
    for one in power(scores):
        if one.rate.of:
            reach = f"{one.low:g} and more" if math.isinf(one.high) else f"{one.low:g} to {one.high:g}"
            yield f"| {reach} | {one.rate.of} | {_rate(one.rate)} |"


def _cuts(known: Sequence[RigScore]) -> Iterator[tuple[str, list[RigScore]]]:
    """Yield groups of rigs that share how they were seen."""
    for noise in sorted({one.noise for one in known}):
        yield f"{noise} noise", [one for one in known if one.noise == noise]
    for low, high in itertools.pairwise(_NOISES_MM):
        inside = [one for one in known if low <= _EDGE_MM * one.sigma < high]
        if inside:
            yield f"noise of {low:g} to {high:g} mm", inside
    for camera, words in ((True, "through the camera"), (False, "positions without a picture")):
        inside = [one for one in known if one.through_camera == camera]
        if inside and len(inside) < len(known):
            yield words, inside
    for engine, title in (("pybullet", "PyBullet"), ("mujoco", "MuJoCo")):
        inside = [one for one in known if one.engine == engine and not one.through_camera]
        if inside and len(inside) < len(known):
            yield f"positions from {title}", inside


def _errors(results: Results, folder: str) -> Iterator[str]:
    yield "\n## Runs held out\n"
    yield (
        "The gap lies between the error of the five parameters, refitted, and the error of the true path, "
        f"which is noise alone. Rigs with an effect that varies at random (`{CHANCE}`) are left out, because "
        "no prediction closes their gap, and so are rigs without a gap. Predictions of all methods start "
        "from the true position, because noise there shifts a whole path.\n"
    )
    yield "| rigs | with a gap | closed, median | 10th percentile |"
    yield "| --- | --- | --- | --- |"
    for words, inside in (
        ("effects of the catalogue", of_catalogue(results.scores)),
        ("unlisted", in_group(results.scores, UNLISTED)),
    ):
        closed = gaps(inside)
        if closed:
            low = f"{np.quantile(closed, 0.1):.3f}"
            middle = _quantity(Quantity.median(closed))
            yield f"| {words} | {len(closed)} of {len(inside)} | {middle} | {low} |"
    yield from left_out_runs(results.scores)
    yield ""
    yield from _picture(
        folder,
        "gaps",
        "Share of the gap closed in each rig with effects of the catalogue, sorted and cut off at -1; the "
        "dashed line is the true path.",
    )


def _methods(results: Results) -> Iterator[str]:
    standings = results.standings
    if len(standings) < 2:
        return
    yield "\n## Beside other methods, on the same rigs\n"
    yield (
        "| method | named exactly or in a tie | reports missing physics where there is some | reports it "
        "where there is none | gap closed | error over the true path's | seconds |"
    )
    yield "| --- | --- | --- | --- | --- | --- | --- |"
    for one in standings:
        if one.missing:
            yield f"| {one.title} | {one.missing} | | | | | |"
            continue
        rates = (
            _rate(rate) if rate is not None else "does not say"
            for rate in (one.named, one.detected, one.alarms)
        )
        closed, over = (_quantity(value) if value.of else "" for value in (one.closed, one.over_oracle))
        yield f"| {one.title} | {' | '.join(rates)} | {closed} | {over} | {one.seconds:.1f} |"
    yield ""
    tried, all_of_them = len({one.rig for one in results.entries}), len(results.scores)
    few = f" They were run on {tried} of {all_of_them} rigs." if tried < all_of_them else ""
    yield f"Medians over all rigs with hidden physics. The methods are in `python/irt/proof/baselines/`.{few}"


def _one_more(results: Results) -> Iterator[str]:
    """Yield what one more run does to ties, where the concealed world could record it."""
    if not results.ties:
        return
    yield "\n## Ties, and one more run\n"
    yield (
        f"For {len(results.ties)} rigs whose tie contained the truth, one more run was recorded and the rig "
        "diagnosed again: once with the run that `irt suggest` designs, once with a random run of the same "
        "families.\n"
    )
    yield "| one more run | named exactly, without a tie | tie size before | after |"
    yield "| --- | --- | --- | --- |"
    before = np.mean([one.before for one in results.ties])
    for kind in KINDS:
        exact = [one.exact[kind] for one in results.ties]
        sizes = [one.after[kind] or 0.0 for one in results.ties if one.after[kind]]
        after = f"{np.mean(sizes):.2f}" if sizes else ""
        yield f"| {kind} | {_rate(Rate(sum(exact), len(exact)))} of {len(exact)} | {before:.2f} | {after} |"


def _intervals(scores: Sequence[RigScore], folder: str) -> Iterator[str]:
    yield "\n## Intervals\n"
    yield "| 95 % intervals of | contain the truth | with an open end, not counted |"
    yield "| --- | --- | --- |"
    for words, of_effects in (
        ("the five parameters", False),
        ("effects that were named rightly", True),
        ("all", None),
    ):
        rate, ajar = coverage(scores, of_effects=of_effects)
        yield f"| {words} | {_rate(rate)} of {rate.of} | {ajar} |"
    yield ""
    yield from _picture(
        folder, "coverage", "Share of the closed intervals that contain the truth, by parameter."
    )
    seconds = [one.seconds for one in scores if math.isfinite(one.seconds)]
    if seconds:
        yield (
            f"A diagnosis took {np.median(seconds):.0f} s of one core (median; the longest "
            f"{np.max(seconds):.0f} s)."
        )


def _how(settings: Mapping[str, str]) -> Iterator[str]:
    yield "\n## How it was done\n"
    yield (
        "1. The list of rigs, the code that diagnoses them and a commitment to a secret seed were written to "
        "`plan.json`. The seed decides which rig hides what.\n"
        "2. Another program recorded every rig. Its label was encrypted (ChaCha20-Poly1305), and a "
        "commitment to it, the SHA-256 of the label and a secret nonce, went into `commitments.json`.\n"
        "3. Each rig was then diagnosed by a process that got a copy of its recordings under a neutral name. "
        "The SHA-256 of every answer went into `manifest.json`.\n"
        "4. Only then were seed and key written to `keys.json`, for that manifest.\n"
        "5. Labels were checked against commitments, plan and seed, answers against the manifest, and "
        "recordings against labels, before scores were computed. `irt prove --verify` checks them again."
    )
    yield "\n| | |\n| --- | --- |"
    for title, words in settings.items():
        yield f"| {title} | {words} |"


def _made(results: Results) -> dict[str, str]:
    titles = {"world": "recorded by", "code": "diagnosed by", "commit": "commit", "seed": "seed"}
    return {title: results.provenance[name] for name, title in titles.items() if results.provenance.get(name)}


def _hashes(chain: Sequence[Path]) -> Iterator[str]:
    yield "\n| file | SHA-256 |"
    yield "| --- | --- |"
    for path in chain:
        yield f"| `{path.name}` | `{digest(path.read_bytes())}` |"


def _rival_gaps(results: Results) -> Iterator[tuple[str, list[float]]]:
    """Yield the share of the gap that each other method closes in the rigs that count."""
    known = {one.rig: one for one in of_catalogue(results.scores) if one.closed is not None}
    for name, title in (
        ("single", "best single effect"),
        ("gaussian", "Gaussian process"),
        ("sindy", "PySINDy"),
    ):
        closed = []
        for one in results.entries:
            errors = known[one.rig].errors if one.rig in known else None
            if one.method == name and one.error is not None and errors is not None:
                closed.append(errors.closed(one.error) or 0.0)
        yield title, closed


def _picture(folder: str, name: str, caption: str) -> Iterator[str]:
    yield f"![{caption}]({folder}/{name}.png)\n"
    yield f"*{caption}*\n"


def _kept(floor: Floor) -> str:
    if floor.kept is None:
        return "not counted"
    if floor.sure:
        return "yes" if floor.kept else "**no**"
    return "yes, though not with 95 % confidence" if floor.kept else "**no**, though not with 95 % confidence"


def _measured(floor: Floor) -> str:
    if not floor.of:
        return ""
    if floor.what == GAP_CLOSED:
        return f"{floor.value:.3f} ({floor.low:.3f} to {floor.high:.3f})"
    return f"{100 * floor.value:.1f} % ({100 * floor.low:.1f} to {100 * floor.high:.1f})"


def _rate(rate: Rate) -> str:
    if not rate.of:
        return ""
    low, high = rate.interval
    return f"{100 * rate.share:.1f} % ({100 * low:.1f} to {100 * high:.1f})"


def _quantity(value: Quantity) -> str:
    if not value.of:
        return ""
    return f"{value.value:.3g} ({value.low:.3g} to {value.high:.3g})"
