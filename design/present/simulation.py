"""What `poise simulate` shows of its runs: words, CSV or JSON, and pictures beside."""

from __future__ import annotations

from design.analysis.simulate import simulate
from design.analysis.verdict import coarse_step
from design.model.closed_loop import closed_loop
from design.model.laws import LawKind
from design.present import opening, plots, store, terminal, text


def render(
    reference: str,
    scenario: str | None,
    law: LawKind | None,
    gains: str | None,
    form: str,
    plot: str | None,
    animate: str | None,
    output: str | None,
    *,
    strict: bool = False,
) -> str:
    """Run the closed loop through every scenario, or one, in a ``form``: text, csv or json; draw what is asked for."""
    source, problem = opening.opened(reference, law, gains, strict=strict)
    picture = plots.format_of(plot) if plot else None
    if animate:
        plots.gif_only(animate, scenarios=1 if scenario else len(problem.scenarios))
    store.check_writable(plot, animate, output)
    chosen = problem.scenarios if scenario is None else (problem.scenario(scenario),)
    its = problem.given_gains()
    loop = closed_loop(problem.biped, problem.law, problem.theta_d)
    runs = [simulate(loop, each, its, problem.step) for each in chosen]
    for why in filter(None, (coarse_step(loop, each, its, problem.step) for each in chosen)):
        terminal.note(f"warning: do not trust these numbers: {why}")
    if form == "csv":
        result = text.csv_text(runs)
    elif form == "json":
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
    return result
