"""The command ``poise``: reads arguments, calls one function, prints, and chooses the exit code.

Exit codes: 0 met; 1 violated, or infeasible with a proof; 2 bad input, usage, or an internal error; 3 undecided; 130
interrupted. Results go to standard output, everything else to standard error. What computes is imported when it is
needed, so that ``--help`` is quick.
"""

from __future__ import annotations

import os
import signal
import sys
import warnings
from collections.abc import Callable
from functools import wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import Annotated, Any, Literal

COMMAND = os.path.basename(sys.argv[0]).removesuffix(".exe") in ("poise", "cli.py", "__main__.py")
"""Whether this process is the command, and not a program that imports it."""


def _interrupted_at_start(number: int, frame: object) -> None:
    os.write(2, b"poise: interrupted\n")
    os._exit(130)


if COMMAND:
    signal.signal(signal.SIGINT, _interrupted_at_start)  # until `main` watches for it

import typer  # noqa: E402

app = typer.Typer(
    name="poise",
    help=(
        "Find ankle-torque gains that keep a standing biped's foot on the ground, and check them.\n\n"
        "SPEC is a TOML file, or the name of a built-in one (see `poise specs`). Start with:\n\n"
        "    poise synthesize slope"
    ),
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

MET, VIOLATED, BAD, UNDECIDED = 0, 1, 2, 3
CODES = {
    "met": MET, "violated": VIOLATED, "undecided": UNDECIDED, "proved": MET, "disproved": VIOLATED, "unknown": UNDECIDED
}  # fmt: skip

LawName = Literal["pd", "force", "cop"]
ReportFormat = Literal["text", "json", "md", "html", "junit"]

SpecArgument = Annotated[str, typer.Argument(metavar="SPEC", help="TOML file, built-in name, or - for standard input.")]
Strict = Annotated[bool, typer.Option("--strict", help="Treat implausible numbers as errors.")]
GainsOption = Annotated[str | None, typer.Option("--gains", metavar="KP,KD,KF", help="Gains instead of the spec's.")]
LawOption = Annotated[LawName | None, typer.Option("--law", help="Law instead of the spec's.")]
Output = Annotated[str | None, typer.Option("-o", "--output", metavar="FILE", help="Write the result to this file.")]
RunForm = Annotated[Literal["text", "csv", "json"], typer.Option("--format", help="Form of the output.")]
Form = Annotated[Literal["text", "json"], typer.Option("--format", help="Form of the output.")]
Scenario = Annotated[str | None, typer.Option("--scenario", metavar="NAME", help="Only this one.")]
Seed = Annotated[int | None, typer.Option("--seed", min=0, help="Seed of noise and uncertainty.")]
Plot = Annotated[str | None, typer.Option("--plot", metavar="FILE", help="Draw it: .png, .svg or .pdf.")]
TimeLimit = Annotated[float, typer.Option("--time-limit", min=0.1, help="Seconds after which to give up.")]
READING: dict[str, tuple[Any, str | None, str]] = {
    "columns": (str, "NAME=COLUMN[:UNIT],...", "Which column holds what."),
    "delimiter": (str, None, "tab, comma, semicolon, space, or a sign."),
    "decimal": (str, None, "point or comma."),
    "skip_rows": (int, None, "Lines above the one with the names."),
    "rate": (float, "HZ", "Sampling rate, where no column tells the time."),
    "resample": (float, "HZ", "Even out irregular time stamps."),
    "up": (str, "y|z", "The file's axis that points up."),
    "forward": (str, "x|-x|...", "The file's axis towards the toes."),
    "ankle": (str, "X[:UNIT]", "Where the ankle is on that axis, in the file's frame."),
    "allow_gaps": (bool, None, "Mask rows that cannot be read."),
}


def reads_recordings(command: Callable[..., None]) -> Callable[..., None]:
    """``command`` with the options of ``READING`` besides its own; it is handed them as ``how``, a ``Reading``."""

    @wraps(command)
    def run(**given: Any) -> None:
        from design.recordings.reading import Reading

        how = Reading(**{name: given.pop(name) for name in READING})
        command(**given, how=how)

    own = signature(command, eval_str=True)
    parts = [part for part in own.parameters.values() if part.name != "how"]
    for name, (kind, metavar, said) in READING.items():
        option = typer.Option("--" + name.replace("_", "-"), metavar=metavar, help=said)
        wish, default = (bool, False) if kind is bool else (kind | None, None)
        parts.append(Parameter(name, Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[wish, option]))
    run.__signature__ = own.replace(parameters=parts)  # type: ignore[attr-defined]
    run.__annotations__ = {part.name: part.annotation for part in parts}
    return run


@app.command()
def specs() -> None:
    """List the built-in specs."""
    from design.present import terminal, text

    terminal.out(text.builtin_lines())


@app.command()
def init(name: Annotated[str, typer.Argument(metavar="NAME", help="A built-in spec.")] = "slope") -> None:
    """Print a built-in spec, commented, to begin one's own: poise init slope > mine.toml."""
    from design.present import terminal
    from design.spec.load import builtin_text

    terminal.out(builtin_text(name))


@app.command()
def schema() -> None:
    """Print the JSON Schema of spec files, with which an editor completes and checks them."""
    from design.present import terminal
    from design.present.store import dumps
    from design.spec.schema import json_schema

    terminal.out(dumps(json_schema()))


@app.command()
def simulate(
    spec: SpecArgument,
    scenario: Scenario = None,
    law: LawOption = None,
    gains: GainsOption = None,
    format: RunForm = "text",
    plot: Plot = None,
    animate: Annotated[str | None, typer.Option(metavar="FILE.gif", help="Draw the biped; one scenario.")] = None,
    output: Output = None,
    strict: Strict = False,
) -> None:
    """Run the closed loop through every scenario, or one."""
    from design.present import simulation, terminal

    result = simulation.render(spec, scenario, law, gains, format, plot, animate, output, strict=strict)
    terminal.deliver(result, output)


@app.command()
def synthesize(
    spec: SpecArgument,
    maximise: Annotated[str | None, typer.Option(metavar="ROW", help="Make this row large instead.")] = None,
    minimise: Annotated[str | None, typer.Option(metavar="ROW", help="Make it small; goals: the soft ones.")] = None,
    law: LawOption = None,
    starts: Annotated[int | None, typer.Option("--starts", min=1, max=1000, help="Number of starts.")] = None,
    nominal: Annotated[bool, typer.Option("--nominal", help="For the nominal body, not all of [uncertainty].")] = False,
    bracket: Annotated[bool, typer.Option("--global", help="Bound the best that any gains can do.")] = False,
    sensitivities: Annotated[bool, typer.Option("--sensitivities", help="Solve what one per cent more buys.")] = False,
    why_not: Annotated[bool, typer.Option(help="If there are none: what excludes what, and what would do.")] = True,
    time_limit: TimeLimit = 600.0,
    format: Form = "text",
    output: Output = None,
    strict: Strict = False,
) -> None:
    """Find the gains with the largest margin that meet every requirement in every scenario, for every body.

    ROW is any row of the report. With -o FILE the design is written as JSON, for `poise report FILE`.
    """
    from design.present import terminal
    from problems import commands

    search = commands.Search(maximise, minimise, starts, nominal, bracket, sensitivities, why_not, time_limit)
    printed, word = commands.synthesize(spec, law, search, format, output, strict=strict)
    terminal.deliver(printed, None)
    raise typer.Exit({"solved": MET, "infeasible": VIOLATED}.get(word, UNDECIDED))


@app.command()
def tradeoff(
    spec: SpecArgument,
    rows: Annotated[list[str] | None, typer.Argument(metavar="[ROW]...", help="Further ROWs of --between.")] = None,
    between: Annotated[
        list[str] | None, typer.Option(metavar="ROW [ROW [ROW]]", help="The margins: A B or A,B.")
    ] = None,
    points: Annotated[int, typer.Option("--points", min=2, max=500, help="Designs, the ends among them.")] = 15,
    point: Annotated[str | None, typer.Option(metavar="K|knee", help="Write this one to -o, for `report`.")] = None,
    law: LawOption = None,
    time_limit: TimeLimit = 600.0,
    format: Annotated[Literal["text", "json", "csv", "md"], typer.Option(help="Form of the output.")] = "text",
    plot: Plot = None,
    output: Output = None,
    strict: Strict = False,
) -> None:
    """Find what one margin costs in another: the front of two or three, each point a design that is checked.

    With -o FILE.html, .md, .csv or .json the form follows the file's ending.
    """
    from problems.tradeoff import command

    asked = [*(between or []), *(rows or [])]
    answer = command.tradeoff(spec, law, asked, points, time_limit, point, format, plot, output, strict=strict)
    raise typer.Exit(CODES[answer])


@app.command()
@reads_recordings
def report(
    spec: Annotated[str, typer.Argument(metavar="SPEC|DESIGN", help="Spec, or a design.json of `synthesize`.")],
    law: LawOption = None,
    gains: GainsOption = None,
    against: Annotated[str | None, typer.Option("--against", metavar="SPEC|DESIGN", help="Beside another.")] = None,
    record: Annotated[str | None, typer.Option("--record", metavar="FILE", help="Judge this measured trial.")] = None,
    prove: Annotated[bool, typer.Option("--prove", help="Prove what can be, at every time and over the box.")] = False,
    time_limit: TimeLimit = 60.0,
    format: Annotated[ReportFormat, typer.Option("--format", help="Form of the output.")] = "text",
    output: Output = None,
    strict: Strict = False,
    *,
    how: Any,
) -> None:
    """Say of every requirement whether it is kept, by how much, and where it is worst.

    With --against the two designs stand side by side; the exit code is the first one's. With -o FILE.html, .md, .json
    or .xml the form follows the file's ending. The options below --strict say how to read the FILE of --record.
    """
    from design.present import reporting, terminal

    written, verdict = reporting.render(
        spec, law, gains, against, record, time_limit if prove else None, how, format, output, strict=strict
    )
    terminal.deliver(written, output)
    raise typer.Exit(CODES[verdict])


@app.command()
def prove(
    spec: Annotated[str, typer.Argument(metavar="SPEC|DESIGN", help="Spec, or a design.json of `synthesize`.")],
    scenario: Scenario = None,
    scale: Annotated[float, typer.Option(min=0.0, max=1e3, help="Of the box of [uncertainty]; 0: no box.")] = 1.0,
    time_limit: TimeLimit = 60.0,
    largest: Annotated[bool, typer.Option("--largest", help="Also seek the largest box that is proved.")] = False,
    certificate: Annotated[str | None, typer.Option(metavar="FILE", help="Write a proof for `poise check`.")] = None,
    law: LawOption = None,
    gains: GainsOption = None,
    format: Form = "text",
    output: Output = None,
    strict: Strict = False,
) -> None:
    """Prove contact and stability at every time, for every body and world within [uncertainty]; or break them.

    PROVED, DISPROVED (with a counterexample) or UNKNOWN: exit code 0, 1 or 3.
    """
    from design.present import proving, terminal

    written, answer = proving.render(
        spec, law, gains, scenario, scale, time_limit, format, output,
        certificate=certificate, largest=largest, strict=strict,
    )  # fmt: skip
    terminal.deliver(written, output)
    raise typer.Exit(CODES[answer])


@app.command()
def check(
    certificate: Annotated[str, typer.Argument(metavar="CERTIFICATE", help="A file of `poise prove --certificate`.")],
    spec: Annotated[str | None, typer.Argument(metavar="SPEC", help="The spec that it must be for.")] = None,
    format: Form = "text",
) -> None:
    """Check a certificate, by a small program in whole numbers that shares no code with the prover.

    CONFIRMED or REFUSED: exit code 0 or 1.
    """
    from design.checking import words
    from design.present import terminal
    from design.spec.load import load

    written, confirmed = words.render(certificate, load(spec).sha256 if spec else None, format)
    terminal.out(written)
    raise typer.Exit(MET if confirmed else VIOLATED)


@app.command()
def region(
    spec: Annotated[str, typer.Argument(metavar="SPEC|DESIGN", help="Spec, or a design.json of `synthesize`.")],
    scenario: Scenario = None,
    law: LawOption = None,
    gains: GainsOption = None,
    format: Form = "text",
    plot: Plot = None,
    output: Output = None,
    strict: Strict = False,
) -> None:
    """Find a set of states from which the loop provably keeps contact and comes to rest, where the force rests.

    An ellipsoid of largest volume, confirmed in exact arithmetic; exit code 0 where there is one, else 3.
    """
    from problems.region import command

    raise typer.Exit(CODES[command.region(spec, law, gains, scenario, format, plot, output, strict=strict)])


@app.command()
@reads_recordings
def estimate(
    file: Annotated[str, typer.Argument(metavar="FILE", help="Text, .npy, .npz, .c3d, or - for standard input.")],
    *,
    spec: Annotated[str | None, typer.Option(metavar="SPEC", help="Whose body and foot it is.")] = None,
    format: RunForm = "text",
    plot: Plot = None,
    as_spec: Annotated[str | None, typer.Option(metavar="OUT.toml", help="Write the force as a scenario.")] = None,
    every: Annotated[float | None, typer.Option(metavar="SECONDS", help="Interval of its points.")] = None,
    output: Output = None,
    strict: Strict = False,
    how: Any,
) -> None:
    """Read a recording: contact forces, centre of pressure, their margins, and the external force.

    A NAME is one of time, fz (vertical force), fx (forward force), cop (forward), my (moment, CoP = -my/fz), toe, heel,
    angle, rate, torque, com_x, com_y, ankle_x, ankle_y. What usual names and the data make clear is found and said.
    """
    from design.present import recording, terminal

    terminal.deliver(recording.render(file, how, format, spec, plot, as_spec, every, output, strict=strict), output)


@app.command()
def study(
    spec: SpecArgument,
    controllers: Annotated[str | None, typer.Option(metavar="A,B,...", help="Left out: all.")] = None,
    trials: Annotated[int | None, typer.Option("--trials", min=1, help="Trials of each controller.")] = None,
    seed: Seed = None,
    jobs: Annotated[int | None, typer.Option("--jobs", min=1, max=1024, help="Worker processes.")] = None,
    dask: Annotated[str | None, typer.Option("--dask", metavar="ADDRESS", help="Run on this dask cluster.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the study in the folder of -o.")] = False,
    repair: Annotated[bool, typer.Option("--repair", help="With --resume: leave out damaged lines.")] = False,
    force_new: Annotated[bool, typer.Option("--force-new", help="Begin anew; keep the old trials beside.")] = False,
    tune: Annotated[bool, typer.Option("--tune/--no-tune", help="Tune the weights that [mpc] does not write.")] = True,
    format: Form = "text",
    output: Annotated[str | None, typer.Option("-o", "--output", metavar="FOLDER", help="Keep trials there.")] = None,
    strict: Strict = False,
) -> None:
    """Compare the paper's laws with LQR and predictive controllers, trial by trial in the same world and noise.

    Controllers: pd, force, cop (with the spec's gains), each with -synthesized (with the best ones), lqr (clipped to
    what keeps contact), mpc, nmpc, mpc-oracle (knows the force), mpc-preview (and its future). The weights of those
    with a model are tuned on the nominal body by the spec's objective.
    """
    from design.present import terminal
    from problems import commands

    asked = (controllers, trials, seed, jobs, dask)
    printed, complete = commands.study(
        spec, *asked, format, output, resume=resume, repair=repair, force_new=force_new, tune=tune, strict=strict
    )
    terminal.deliver(printed, None)
    raise typer.Exit(MET if complete else UNDECIDED)


@app.command()
def trials(
    spec: SpecArgument,
    trials: Annotated[int | None, typer.Option(min=1, max=1000, help="Of each scenario; 3 if left out.")] = None,
    scenario: Scenario = None,
    sequence: Annotated[str | None, typer.Option(metavar="A,B,...", help="The scenario of each trial.")] = None,
    blind: Annotated[bool, typer.Option("--blind", help="Start from the estimate whatever the world is.")] = False,
    seed: Seed = None,
    law: LawOption = None,
    gains: GainsOption = None,
    format: Form = "text",
    plot: Plot = None,
    output: Output = None,
    strict: Strict = False,
) -> None:
    """Run trials in a row, each started in the posture that the last one's estimate of the force gives."""
    from problems.trials import command

    asked = command.Asked(trials, scenario, sequence, seed, blind)
    raise typer.Exit(CODES[command.trials(spec, law, gains, asked, format, plot, output, strict=strict)])


@app.command()
def explain(row: Annotated[str, typer.Argument(metavar="ROW", help="A row's id, as in the report.")]) -> None:
    """Explain a row of the report: what it says, why it matters, its formula, how to improve it."""
    from design.present import terminal
    from design.present.explain import explain as page

    terminal.out(page(row) + "\n")


@app.command()
def doctor() -> None:
    """Print versions, optional parts, cores, and the result of a self-test; exit code 0 if all is well, else 2."""
    from design.present import doctor, terminal

    text, sound = doctor.examination(terminal.cores())
    terminal.out(text)
    raise typer.Exit(MET if sound else BAD)


def _shadow() -> str | None:
    """The file that another program's ``design`` or ``problems`` would be loaded from, if it comes before ours."""
    from importlib.util import find_spec

    here = Path(__file__).resolve().parent
    for name in ("design", "problems"):
        found = find_spec(name)
        place = Path(found.origin).resolve() if found and found.origin else None
        if place is None or place.parent.parent != here:
            return str(place or name)
    return None


def main() -> None:
    """Run ``poise``; every way to end is one of the exit codes."""
    debug = "--debug" in sys.argv
    if debug:
        sys.argv.remove("--debug")
    shadow = _shadow()
    if shadow:
        said = "is imported in place of Poise's own module of that name; move it, or unset PYTHONPATH"
        sys.stderr.write(f"poise: {shadow} {said}\n")
        sys.exit(BAD)
    from design.present import terminal

    if not sys.warnoptions:
        warnings.simplefilter("ignore")  # what libraries remark is for those who develop with them

    def run() -> object:
        from design.present.doctor import check_versions

        if "doctor" not in sys.argv:
            check_versions()
        return app(standalone_mode=False, prog_name="poise")

    code = terminal.ended(run, debug=debug, stops=(KeyboardInterrupt, typer.Abort))
    if COMMAND:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is done; an interrupt of Python's own end says nothing
    sys.exit(code)


if __name__ == "__main__":
    main()
