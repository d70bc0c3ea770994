"""The command ``poise``: reads arguments, calls one function, prints, and chooses the exit code.

Exit codes: 0 met; 1 violated, or infeasible with a proof; 2 bad input, usage, or an internal error; 3 undecided; 130
interrupted. Results go to standard output, everything else to standard error. What computes is imported when it is
needed, so that ``--help`` is quick.
"""

from __future__ import annotations

import io
import os
import sys
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from design.model.laws import Gains
    from design.present.report import Report
    from design.spec.load import Source
    from design.spec.setting import Setting

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


class LawName(StrEnum):
    """The control laws."""

    pd = "pd"
    force = "force"
    cop = "cop"


class ObjectiveName(StrEnum):
    """What synthesis maximises."""

    decay = "decay-rate"
    contact = "contact-force"
    cop = "cop-margin"
    routh = "routh-margin"


class RunFormat(StrEnum):
    """How a run is printed."""

    text = "text"
    csv = "csv"
    json = "json"


class Format(StrEnum):
    """How a result is printed."""

    text = "text"
    json = "json"


class ReportFormat(StrEnum):
    """How a report is printed."""

    text = "text"
    json = "json"
    md = "md"
    html = "html"
    junit = "junit"


SpecArgument = Annotated[str, typer.Argument(metavar="SPEC", help="TOML file, built-in name, or - for standard input.")]
Strict = Annotated[bool, typer.Option("--strict", help="Treat implausible numbers as errors.")]
GainsOption = Annotated[str | None, typer.Option("--gains", metavar="KP,KD,KF", help="Gains instead of the spec's.")]
LawOption = Annotated[LawName | None, typer.Option("--law", help="Law instead of the spec's.")]
Output = Annotated[str | None, typer.Option("-o", "--output", metavar="FILE", help="Write the result to this file.")]


@app.command()
def specs() -> None:
    """List the built-in specs."""
    from design.spec.load import builtin_names, builtin_text, parse

    for name in builtin_names():
        spec = parse(builtin_text(name), origin=name).spec
        out(f"{name:<14} {', '.join(s.name for s in spec.scenarios):<14} {spec.source}\n")


@app.command()
def init(name: Annotated[str, typer.Argument(metavar="NAME", help="A built-in spec.")] = "slope") -> None:
    """Print a built-in spec, commented, to begin one's own: poise init slope > mine.toml."""
    from design.spec.load import builtin_text

    out(builtin_text(name))


@app.command()
def schema() -> None:
    """Print the JSON Schema of spec files, with which an editor completes and checks them."""
    from design.present.store import dumps
    from design.spec.schema import json_schema

    out(dumps(json_schema()))


@app.command()
def simulate(
    spec: SpecArgument,
    scenario: Annotated[str | None, typer.Option("--scenario", metavar="NAME", help="Only this one.")] = None,
    law: LawOption = None,
    gains: GainsOption = None,
    format: Annotated[RunFormat, typer.Option("--format", help="Form of the output.")] = RunFormat.text,
    plot: Annotated[str | None, typer.Option("--plot", metavar="FILE", help="Draw it: .png, .svg or .pdf.")] = None,
    animate: Annotated[
        str | None, typer.Option("--animate", metavar="FILE.gif", help="Draw the biped moving; one scenario.")
    ] = None,
    output: Output = None,
    strict: Strict = False,
) -> None:
    """Run the closed loop through every scenario, or one."""
    source, problem = _read(spec, law, gains, strict)
    from design.analysis.simulate import simulate as run
    from design.model.closed_loop import closed_loop
    from design.present import plots, store, text

    picture = plots.format_of(plot) if plot else None
    if animate:
        plots.gif_only(animate)
    store.check_writable(plot, animate, output)
    chosen = problem.scenarios if scenario is None else (problem.scenario(scenario),)
    its = problem.given_gains()
    loop = closed_loop(problem.biped, problem.law, problem.theta_d)
    runs = [run(loop, each, its, problem.step) for each in chosen]
    if format is RunFormat.csv:
        result = text.csv_text(runs)
    elif format is RunFormat.json:
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
    _deliver(result, output)


@app.command()
def synthesize(
    spec: SpecArgument,
    maximise: Annotated[ObjectiveName | None, typer.Option("--maximise", help="Instead of the spec's.")] = None,
    law: LawOption = None,
    starts: Annotated[int | None, typer.Option("--starts", min=1, max=1000, help="Number of starts.")] = None,
    time_limit: Annotated[float, typer.Option("--time-limit", min=0.1, help="Seconds after which to give up.")] = 600.0,
    format: Annotated[Format, typer.Option("--format", help="Form of the output.")] = Format.text,
    output: Output = None,
    strict: Strict = False,
) -> None:
    """Find the gains with the largest margin that meet every requirement in every scenario.

    With -o FILE the design is written as JSON, for `poise report FILE`.
    """
    source, problem = _read(spec, law, None, strict)
    from dataclasses import replace

    from design.present import store, synthesis
    from problems import gains as question

    if maximise is not None:
        problem = replace(problem, maximise=maximise.value)
    with _progress() as say:
        answer = question.solve(problem, starts=starts, seconds=time_limit, say=say)
    stored = store.dumps(synthesis.document(source, problem, answer))
    printed = stored if format is Format.json else synthesis.text(source, problem, answer, text_paint())
    if output:
        store.write(output, stored)
    _deliver(printed, None)
    word = answer.outcome.status.word
    raise typer.Exit({"solved": MET, "infeasible": VIOLATED}.get(word, UNDECIDED))


@app.command()
def report(
    spec: Annotated[str, typer.Argument(metavar="SPEC|DESIGN", help="Spec, or a design.json of `synthesize`.")],
    law: LawOption = None,
    gains: GainsOption = None,
    against: Annotated[str | None, typer.Option("--against", metavar="SPEC|DESIGN", help="Beside another.")] = None,
    format: Annotated[ReportFormat, typer.Option("--format", help="Form of the output.")] = ReportFormat.text,
    output: Output = None,
    strict: Strict = False,
) -> None:
    """Say of every requirement whether it is kept, by how much, and where it is worst.

    With --against the two designs stand side by side; the exit code is the first one's. With -o FILE.html, .md, .json
    or .xml the form follows the file's ending.
    """
    from design.present import report as present
    from design.present import store

    if output and format is ReportFormat.text:
        format = {".html": ReportFormat.html, ".md": ReportFormat.md, ".json": ReportFormat.json,
                  ".xml": ReportFormat.junit}.get(Path(output).suffix, format)  # fmt: skip
    one = _report(spec, law, gains, strict)
    other = _report(against, None, None, strict, one) if against else None
    paint = text_paint(to_file=output is not None)
    if format is ReportFormat.json:
        result = store.dumps(present.as_json(one, other))
    elif other is not None:
        if format is not ReportFormat.text:
            from design.errors import BadInput

            message = f"is not written as {format.value}; use --format text or json"
            raise BadInput(message, key="--against")
        result = present.comparison(one, other, (spec, against or ""), paint)
    elif format is ReportFormat.md:
        result = present.as_markdown(one)
    elif format is ReportFormat.junit:
        result = present.as_junit(one)
    elif format is ReportFormat.html:
        from design.present.html import as_html

        result = as_html(one)
    else:
        result = present.as_text(one, paint)
    _deliver(result, output)
    raise typer.Exit({"met": MET, "violated": VIOLATED, "undecided": UNDECIDED}[one.verdict.overall])


@app.command()
def explain(row: Annotated[str, typer.Argument(metavar="ROW", help="A row's id, as in the report.")]) -> None:
    """Explain a row of the report: what it says, why it matters, its formula, how to improve it."""
    from design.present.explain import explain as page

    out(page(row) + "\n")


def _report(
    reference: str, law: LawName | None, gains: str | None, strict: bool, beside: Report | None = None
) -> Report:
    """The report on a spec or design; ``beside`` another it is judged by that one's specification."""
    from design.analysis.verdict import judge
    from design.present.report import Report

    source, problem = _read(reference, law, gains, strict)
    its = problem.given_gains()
    if beside is not None:
        source, problem = beside.source, beside.setting.with_law(problem.law, its)
        its = problem.given_gains()
    return Report(source=source, setting=problem, gains=its, verdict=judge(problem, its, "all"))


def _read(reference: str, law: LawName | None, gains: str | None, strict: bool) -> tuple[Source, Setting]:
    """The spec or design at ``reference`` in SI units, under the law and gains of the command line."""
    from design.errors import BadInput
    from design.present.store import read_design
    from design.spec.load import decode, load, parse, read_bytes
    from design.spec.setting import setting

    own: Gains | None = None
    kind: str | None = None
    if reference.endswith(".json"):
        text, own, kind = read_design(decode(read_bytes(reference), reference), reference)
        source = parse(text, origin=reference)
    else:
        source = load(reference)
    for remark in source.remarks:
        if strict:
            message = f"{remark} (--strict)"
            raise BadInput(message, file=source.origin)
        note(f"warning: {source.origin}: {remark}")
    chosen = law.value if law else kind if kind in ("pd", "force", "cop") else None
    return source, setting(source.spec).with_law(chosen, _gains(gains) or own)  # type: ignore[arg-type]


def _gains(text: str | None) -> Gains | None:
    if text is None:
        return None
    from design.errors import BadInput
    from design.model.laws import Gains

    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) == 2:
        numbers.append(0.0)
    if len(numbers) != 3 or not all(0 <= number <= 1e9 for number in numbers):
        message = f"is {text!r}; needs three numbers from 0 to 1e9, as in --gains 3500,1200,1"
        raise BadInput(message, key="--gains")
    return Gains(*numbers)


def out(text: str) -> None:
    """A part of the result, to standard output; who reads it may have seen enough."""
    try:
        sys.stdout.write(text)
        sys.stdout.flush()
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise typer.Exit(MET) from None


def note(text: str) -> None:
    """A line beside the result."""
    sys.stderr.write(text + "\n")


def text_paint(to_file: bool = False) -> Callable[[str, str], str]:
    """Colours where standard output is a terminal and NO_COLOR is not set."""
    from design.present.text import painter

    return painter(sys.stdout.isatty() and not to_file and not os.environ.get("NO_COLOR"))


class _progress:
    """One line on standard error that is written over, where that is a terminal."""

    def __enter__(self) -> Callable[[str], None]:
        self._live = sys.stderr.isatty()

        def say(text: str) -> None:
            if self._live:
                sys.stderr.write(f"\r\033[K{text}")
                sys.stderr.flush()

        return say

    def __exit__(self, *_: object) -> None:
        if self._live:
            sys.stderr.write("\r\033[K")


def _deliver(result: str, output: str | None) -> None:
    from design.present.store import write

    if output:
        write(output, result)
    else:
        out(result)


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
        note(f"poise: {shadow} is imported in place of Poise's own module of that name; move it, or unset PYTHONPATH")
        sys.exit(BAD)
    from design.errors import PoiseError

    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    try:
        code = app(standalone_mode=False, prog_name="poise")
        sys.stdout.flush()
    except PoiseError as error:
        if debug:
            raise
        note(f"poise: {error}")
        code = BAD
    except (KeyboardInterrupt, typer.Abort):
        note("poise: interrupted")
        code = INTERRUPTED
    except Exception as error:
        show = getattr(error, "show", None)
        if show is not None:  # wrong usage, in the words of the command line's library
            show()
            code = BAD
        elif debug:
            raise
        else:
            said = " ".join(str(error).split())[:200]
            note(f"poise: internal error: {type(error).__name__}: {said}; rerun with --debug")
            code = BAD
    sys.exit(code if isinstance(code, int) else MET)


if __name__ == "__main__":
    main()
