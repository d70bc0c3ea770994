"""The command ``poise``: reads arguments, calls one function, prints, and chooses the exit code.

Exit codes: 0 met; 1 violated, or infeasible with a proof; 2 bad input, usage, or an internal error; 3 undecided; 130
interrupted. Results go to standard output, everything else to standard error. What computes is imported when it is
needed, so that ``--help`` is quick.
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Annotated, Literal

import typer

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

MET, VIOLATED, BAD, UNDECIDED, INTERRUPTED = 0, 1, 2, 3, 130


LawName = Literal["pd", "force", "cop"]
Goal = Literal["decay-rate", "contact-force", "cop-margin", "routh-margin"]
RunFormat = Literal["text", "csv", "json"]
ReportFormat = Literal["text", "json", "md", "html", "junit"]
ENDINGS: dict[str, ReportFormat] = {".html": "html", ".md": "md", ".json": "json", ".xml": "junit"}

SpecArgument = Annotated[str, typer.Argument(metavar="SPEC", help="TOML file, built-in name, or - for standard input.")]
Strict = Annotated[bool, typer.Option("--strict", help="Treat implausible numbers as errors.")]
GainsOption = Annotated[str | None, typer.Option("--gains", metavar="KP,KD,KF", help="Gains instead of the spec's.")]
LawOption = Annotated[LawName | None, typer.Option("--law", help="Law instead of the spec's.")]
Output = Annotated[str | None, typer.Option("-o", "--output", metavar="FILE", help="Write the result to this file.")]


@app.command()
def specs() -> None:
    """List the built-in specs."""
    from design.present import terminal
    from design.spec.load import builtin_names, builtin_text, parse

    for name in builtin_names():
        spec = parse(builtin_text(name), origin=name).spec
        terminal.out(f"{name:<14} {', '.join(s.name for s in spec.scenarios):<14} {spec.source}\n")


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
    scenario: Annotated[str | None, typer.Option("--scenario", metavar="NAME", help="Only this one.")] = None,
    law: LawOption = None,
    gains: GainsOption = None,
    format: Annotated[RunFormat, typer.Option("--format", help="Form of the output.")] = "text",
    plot: Annotated[str | None, typer.Option("--plot", metavar="FILE", help="Draw it: .png, .svg or .pdf.")] = None,
    animate: Annotated[
        str | None, typer.Option("--animate", metavar="FILE.gif", help="Draw the biped moving; one scenario.")
    ] = None,
    output: Output = None,
    strict: Strict = False,
) -> None:
    """Run the closed loop through every scenario, or one."""
    from design.present import opening, terminal

    source, problem = opening.opened(spec, law, gains, strict=strict)
    from design.analysis.simulate import simulate as run
    from design.analysis.verdict import coarse_step
    from design.model.closed_loop import closed_loop
    from design.present import plots, store, text

    picture = plots.format_of(plot) if plot else None
    if animate:
        plots.gif_only(animate, scenarios=1 if scenario else len(problem.scenarios))
    store.check_writable(plot, animate, output)
    chosen = problem.scenarios if scenario is None else (problem.scenario(scenario),)
    its = problem.given_gains()
    loop = closed_loop(problem.biped, problem.law, problem.theta_d)
    runs = [run(loop, each, its, problem.step) for each in chosen]
    for why in filter(None, (coarse_step(loop, each, its, problem.step) for each in chosen)):
        terminal.note(f"warning: do not trust these numbers: {why}")
    if format == "csv":
        result = text.csv_text(runs)
    elif format == "json":
        result = store.dumps(store.document("simulate", source, **store.runs_json(problem.law, its, runs)))
    else:
        head = [f"{source.spec.name}, law {problem.law}, {text.gains_line(its, problem.law)}"]
        result = "\n".join([*head, *(line for each in runs for line in text.trajectory_lines(each))]) + "\n"
    if plot and picture:
        figure = plots.run_figure(runs, problem.biped.ell, f"{source.spec.name}: {text.gains_line(its, problem.law)}")
        store.write(plot, plots.figure_bytes(figure, picture))
    if animate:
        from design.present.animation import gif_bytes

        store.write(animate, gif_bytes(problem.biped, runs[0]))
    terminal.deliver(result, output)


@app.command()
def synthesize(
    spec: SpecArgument,
    maximise: Annotated[Goal | None, typer.Option("--maximise", help="Instead of the spec's.")] = None,
    law: LawOption = None,
    starts: Annotated[int | None, typer.Option("--starts", min=1, max=1000, help="Number of starts.")] = None,
    time_limit: Annotated[float, typer.Option("--time-limit", min=0.1, help="Seconds after which to give up.")] = 600.0,
    format: Annotated[Literal["text", "json"], typer.Option("--format", help="Form of the output.")] = "text",
    output: Output = None,
    strict: Strict = False,
) -> None:
    """Find the gains with the largest margin that meet every requirement in every scenario.

    With -o FILE the design is written as JSON, for `poise report FILE`.
    """
    from design.present import opening, terminal

    source, problem = opening.opened(spec, law, strict=strict)
    from dataclasses import replace

    from design.present import store, synthesis
    from problems import gains as question

    if maximise is not None:
        problem = replace(problem, maximise=maximise)
    with terminal.progress() as say:
        answer = question.solve(problem, starts=starts, seconds=time_limit, say=say)
    stored = store.dumps(synthesis.document(source, problem, answer))
    printed = stored if format == "json" else synthesis.text(source, problem, answer, terminal.painter_for_output())
    if output:
        store.write(output, stored)
    terminal.deliver(printed, None)
    word = answer.outcome.status.word
    raise typer.Exit({"solved": MET, "infeasible": VIOLATED}.get(word, UNDECIDED))


@app.command()
def report(
    spec: Annotated[str, typer.Argument(metavar="SPEC|DESIGN", help="Spec, or a design.json of `synthesize`.")],
    law: LawOption = None,
    gains: GainsOption = None,
    against: Annotated[str | None, typer.Option("--against", metavar="SPEC|DESIGN", help="Beside another.")] = None,
    format: Annotated[ReportFormat, typer.Option("--format", help="Form of the output.")] = "text",
    output: Output = None,
    strict: Strict = False,
) -> None:
    """Say of every requirement whether it is kept, by how much, and where it is worst.

    With --against the two designs stand side by side; the exit code is the first one's. With -o FILE.html, .md, .json
    or .xml the form follows the file's ending.
    """
    from design.present import drawing, terminal

    if output and format == "text":
        format = ENDINGS.get(Path(output).suffix, format)
    with drawing.pen(apart=format == "html") as pen:
        from design.present import opening
        from design.present import report as present

        one = opening.judged(spec, law, gains, strict=strict)
        other = opening.judged(against, strict=strict, beside=one) if against else None
        paint = terminal.painter_for_output(to_file=output is not None)
        written = present.render(format, one, other, (spec, against or ""), paint, pen)
    terminal.deliver(written, output)
    raise typer.Exit({"met": MET, "violated": VIOLATED, "undecided": UNDECIDED}[one.verdict.overall])


@app.command()
def study(
    spec: SpecArgument,
    controllers: Annotated[
        str | None,
        typer.Option(
            "--controllers",
            metavar="A,B,...",
            help="Of: pd, force, cop (with the spec's gains), each with -synthesized (with the best ones), mpc, nmpc,"
            " mpc-oracle (knows the force), mpc-preview (and its future). Left out: all.",
        ),
    ] = None,
    trials: Annotated[int | None, typer.Option("--trials", min=1, help="Trials of each controller.")] = None,
    seed: Annotated[int | None, typer.Option("--seed", min=0, help="Seed of noise and uncertainty.")] = None,
    jobs: Annotated[int | None, typer.Option("--jobs", min=1, max=1024, help="Worker processes.")] = None,
    dask: Annotated[str | None, typer.Option("--dask", metavar="ADDRESS", help="Run on this dask cluster.")] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue the study in the folder of -o.")] = False,
    format: Annotated[Literal["text", "json"], typer.Option("--format", help="Form of the output.")] = "text",
    output: Annotated[
        str | None, typer.Option("-o", "--output", metavar="FOLDER", help="Keep trials and reports in this folder.")
    ] = None,
    strict: Strict = False,
) -> None:
    """Compare the paper's laws with predictive controllers, trial by trial in the same world and noise."""
    from design.present import opening, terminal

    source, problem = opening.opened(spec, strict=strict)
    from design.present import store, study_folder, study_text
    from problems.comparison import conduct as question

    names = [name.strip() for name in controllers.split(",")] if controllers else None
    problem, names = question.with_options(problem, trials=trials, seed=seed, controllers=names)
    study_folder.check(output, resume=resume)
    with terminal.progress() as say, terminal.terminated_like_interrupted(), study_folder.kept(output):
        found = question.conduct(
            source, problem, names, folder=output, resume=resume, jobs=jobs or terminal.cores(), dask=dask, say=say
        )
    document = store.document("study", source, **question.facts(found, problem))
    if output:
        study_folder.write(output, document, found.rows)
    paint = terminal.painter_for_output()
    terminal.deliver(store.dumps(document) if format == "json" else study_text.as_text(document, paint), None)
    raise typer.Exit(MET if document["status"] == "complete" else UNDECIDED)


@app.command()
def explain(row: Annotated[str, typer.Argument(metavar="ROW", help="A row's id, as in the report.")]) -> None:
    """Explain a row of the report: what it says, why it matters, its formula, how to improve it."""
    from design.present import terminal
    from design.present.explain import explain as page

    terminal.out(page(row) + "\n")


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
    from design.errors import PoiseError
    from design.present import terminal

    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        with terminal.insistent_interrupts():
            code = app(standalone_mode=False, prog_name="poise")
        sys.stdout.flush()
    except PoiseError as error:
        if debug:
            raise
        terminal.note(f"poise: {error}")
        code = BAD
    except (KeyboardInterrupt, typer.Abort):
        terminal.note("poise: interrupted")
        code = INTERRUPTED
    except Exception as error:
        if debug and not terminal.is_usage(error):
            raise
        terminal.failed(error)
        code = BAD
    sys.exit(code if isinstance(code, int) else MET)


if __name__ == "__main__":
    main()
