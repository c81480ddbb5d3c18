"""The page of a proof on a real rig."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from irt.display import listed
from irt.files import as_typed, read_json
from irt.model import Parameter
from irt.proof.real.plots import plot_intervals, plot_tilt
from irt.proof.real.response import Comparison, Estimate
from irt.proof.real.run import MODELS, RealProof
from irt.proof.seal import digest
from irt.report.page import Picture, Table, write_page
from irt.report.words import change, counted, plain, scaled, versions, with_interval

_MRAD = 1000.0
#: Most recordings with a picture.
_MOST_RUNS = 8
_LIMITS = (
    "The tilt judges what acts between command and board. Physics of the marble, the rim and the camera is "
    "judged by held-out recordings, in the report of the diagnosis.",
    "Measured delay, lag and play come from a fit, too: a board that moves otherwise, for example by jumps, "
    "is described by the nearest values. Their intervals are at least those of fits without each recording, "
    "where there are three or more, and a row for times.",
    "Where one camera sees marble and markers, late pictures delay both. Such a latency is part of the "
    "measured delay.",
    "Zero and gain of the tilt sensor are unknown. The gain is compared as the sensor reads it.",
)


def write_real_page(found: RealProof) -> Path:
    """Write ``report.html`` and its pictures beside the numbers, and return the page's path.

    Raises
    ------
    IrtError
        If a file cannot be written.
    """
    folders = found.folders
    sealed = read_json(folders.seal)
    intervals = folders.out / "intervals.svg"
    plot_intervals(intervals, found.comparisons)
    contradicted = [one for one in found.comparisons if not one.overlaps]
    path = folders.out / "report.html"
    write_page(
        path,
        "real.html",
        title=f"{found.rig.path.name}: a diagnosis against the measured tilt",
        lead=_lead(found),
        key_figures=list(_key_figures(found)),
        steps=list(_steps(found)),
        summary=found.diagnosis["summary"],
        intervals=Picture(
            intervals, "Values and 95 % intervals about x and y: of the diagnosis, and of the tilt."
        ),
        quantities=_quantities(found),
        contradicted=[_sentence(one) for one in contradicted],
        notes=list(_notes(found)),
        errors=_errors(found),
        by_run=_by_run(found) if len(found.runs) > 1 else None,
        how=_how(found),
        over_time=list(_over_time(found)),
        pictured=min(len(found.runs), _MOST_RUNS),
        runs=len(found.runs),
        limits=_LIMITS,
        blind=as_typed(folders.blind),
        out=as_typed(folders.out),
        settings={
            "command": f"irt prove --real {as_typed(found.rig.path)} --out {as_typed(folders.out)}",
            "code": sealed["code"],
            "seal.json": f"SHA-256 {digest(folders.seal.read_bytes())}",
            "answer.json": f"SHA-256 {digest(folders.answer.read_bytes())}",
            **versions(),
        },
    )
    return path


def sentences(found: RealProof) -> Iterator[str]:
    """Yield the lines that the command prints."""
    yield _lead(found)
    yield f"\nroot mean square of measured minus predicted tilt, after zero, {_how(found)}"
    for name, title in MODELS.items():
        x, y = found.errors[name]
        yield f"  {title:<28} about x {_mrad(x.zero):>9}   about y {_mrad(y.zero):>9}"
    yield "\nresponse of the board, predicted without the tilt and measured (95 % intervals)"
    for one in found.comparisons:
        title = f"{one.quantity.title} about {one.axis}"
        yield (
            f"  {title:<20} {_shown(one, one.predicted):<32} {_shown(one, one.measured):<32} {_verdict(one)}"
        )


def _lead(found: RealProof) -> str:
    names = [plain(one["name"]) for one in found.diagnosis["effects"]]
    named = listed(names) if len(names) > 1 else "".join(names) or "no effect"
    tuned, diagnosed = found.errors["tuned"], found.errors["diagnosed"]
    return (
        f"From commands and marble alone, the diagnosis named {named}. The board's tilt, which it never "
        f"saw, lies {_mrad(diagnosed[0].zero)} (about x) and {_mrad(diagnosed[1].zero)} (about y) off its "
        f"prediction; that of the same simulator without effects is {_mrad(tuned[0].zero)} and "
        f"{_mrad(tuned[1].zero)} off."
    )


def _key_figures(found: RealProof) -> Iterator[tuple[str, str]]:
    tuned, diagnosed, fitted = (found.errors[name] for name in ("tuned", "diagnosed", "fitted"))
    for axis, before, after, least in zip("xy", tuned, diagnosed, fitted, strict=True):
        yield (
            change(before.zero, after.zero),
            f"error of the tilt about {axis} with the named effects, after zero ({_mrad(before.zero)} to "
            f"{_mrad(after.zero)}; a fit to the tilt itself leaves {_mrad(least.zero)})",
        )
    count = len(found.comparisons)
    yield f"{found.held} of {count}", "measured numbers lie in the 95 % interval of the diagnosis"
    agree = sum(one.overlaps for one in found.comparisons)
    yield f"{agree} of {count}", "intervals of the diagnosis overlap with the measured ones"


def _steps(found: RealProof) -> Iterator[str]:
    marbles = sum(one.has_marble for one in found.runs)
    yield (
        f"The tilt columns of {counted(marbles, 'recording')} were left out of a copy of the rig, and the "
        "SHA-256 of the recordings was written to `seal.json`."
    )
    yield "`irt diagnose` read that copy: commands, stamps and positions of the marble."
    yield "The SHA-256 of its models was written to `answer.json` before anything was compared with the tilt."
    yield "Then delay, lag and play were fitted to commands and measured tilt, without the answer."
    yield "This page compares the two."


def _how(found: RealProof) -> str:
    if all(run.held_out for run in found.runs):
        return "each recording predicted by models fitted to the other recordings"
    return "predicted by models that were fitted to the commands and the marble of the same recording"


def _quantities(found: RealProof) -> Table:
    rows = []
    for one in found.comparisons:
        title = f"{one.quantity.title} about {one.axis}"
        rows.append([title, _shown(one, one.predicted), _shown(one, one.measured), _verdict(one)])
    return Table(
        "Value and 95 % interval; whether the measured value lies inside the interval of the diagnosis",
        ["", "predicted", "measured", "measured value"],
        rows,
    )


def _verdict(one: Comparison) -> str:
    return "inside" if one.holds else "intervals overlap" if one.overlaps else "contradicted"


def _shown(one: Comparison, estimate: Estimate) -> str:
    """Return an estimate as text, with angles in mrad; 0 for an effect that is in no plausible set."""
    if estimate.value == estimate.low == estimate.high == 0.0:
        return "0"
    ends = (estimate.low, estimate.high) if estimate.has_interval else (None, None)
    value = Parameter(estimate.value, *ends)
    if one.quantity.unit == "rad":
        return f"{with_interval(scaled(_MRAD, value))} mrad"
    return f"{with_interval(value)} {one.quantity.unit}".rstrip()


def _sentence(one: Comparison) -> str:
    what = f"{one.quantity.title} about {one.axis} ({one.quantity.means})"
    return f"{what}: predicted {_shown(one, one.predicted)}, measured {_shown(one, one.measured)}."


def _notes(found: RealProof) -> Iterator[str]:
    for one in found.diagnosis["effects"]:
        if one["confusable_with"]:
            ties = listed(map(plain, [one["name"], *one["confusable_with"]]), "or")
            yield (
                f"The diagnosis left open which of {ties} acts; its intervals contain all of them, by their "
                "probabilities."
            )
    if len(found.runs) < 3:
        yield (
            "With fewer than three recordings the measured intervals come from the curvature of the fit "
            "alone, and are too narrow where residuals repeat from row to row."
        )


def _errors(found: RealProof) -> Table:
    kinds = {"raw": "raw", "zero": "zero", "gain": "gain, zero"}
    rows = [
        [title, *(_number(getattr(of, kind)) for kind in kinds for of in found.errors[name])]
        for name, title in MODELS.items()
    ]
    caption = "Root mean square [mrad] about x and y: raw, after zero, and after gain and zero"
    return Table(caption, ["", *(f"{axis}, {words}" for words in kinds.values() for axis in "xy")], rows)


def _by_run(found: RealProof) -> Table:
    rows = []
    for run in found.runs:
        of = run.errors
        errors = [of[name][axis].zero for axis in range(2) for name in ("tuned", "diagnosed")]
        rows.append([run.name if run.has_marble else f"{run.name} (no marble)", *map(_number, errors)])
    header = ["recording", *(f"{axis}, {what}" for axis in "xy" for what in ("no effects", "diagnosed"))]
    return Table("Root mean square by recording [mrad], after zero", header, rows)


def _over_time(found: RealProof) -> Iterator[Picture]:
    for number, run in enumerate(found.runs[:_MOST_RUNS], start=1):
        path = found.folders.out / f"tilt-{number}.svg"
        plot_tilt(path, run)
        x, y = run.errors["diagnosed"]
        off = f"{_mrad(x.zero)} about x and {_mrad(y.zero)} about y"
        yield Picture(path, f"{run.name}: {off} off the prediction of the diagnosis.")


def _mrad(angle: float) -> str:
    return f"{_number(angle)}\N{NO-BREAK SPACE}mrad"


def _number(angle: float) -> str:
    """Return an angle [rad] in mrad, without the unit."""
    value = _MRAD * angle
    return f"{value:.{2 if value < 10.0 else 1}f}"
