"""Where the time of a whole report goes, HTML included; skipped unless asked for with ``--benchmark-only``."""

import subprocess
import sys
import time
from pathlib import Path

from design.analysis.loop_curves import loop_curves
from design.analysis.verdict import judge
from design.present import html, plots, report_plots
from design.present.report import Report
from design.spec.load import load
from design.spec.setting import setting

ROOT = Path(__file__).resolve().parents[2]


def _timed(function):
    start = time.perf_counter()
    result = function()
    return result, time.perf_counter() - start


def test_a_whole_report_and_where_its_time_goes(benchmark, capsys, tmp_path):
    page = tmp_path / "report.html"

    def run():
        command = [sys.executable, "cli.py", "report", "slope", "-o", str(page)]
        subprocess.run(command, cwd=ROOT, check=True, capture_output=True)

    def bare():
        code = "import casadi, pydantic, typer, jinja2, matplotlib.backends.backend_svg, matplotlib.figure"
        subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True)

    benchmark.pedantic(run, rounds=3, warmup_rounds=1)
    whole = benchmark.stats.stats.median
    imports = min(_timed(bare)[1] for _ in range(3))
    source = load("slope")
    problem = setting(source.spec)
    verdict, judging = _timed(lambda: judge(problem, problem.gains, "all", drawn=True))
    report = Report(source=source, setting=problem, gains=problem.gains, verdict=verdict)
    curves = loop_curves(problem, problem.gains)
    _, runs = _timed(lambda: html.svg(plots.run_figure(verdict.trajectories, problem.biped, "")))
    _, loops = _timed(lambda: (html.svg(report_plots.loop_figure(curves)), html.svg(report_plots.locus_figure(curves))))
    _, pages = _timed(lambda: html.as_html(report))
    with capsys.disabled():
        sys.stdout.write(
            f"\nreport slope -o report.html: {whole:.2f} s, of which imports alone {imports:.2f} s; in one process:"
            f" judging {judging:.2f} s, the page {pages:.2f} s (the runs' picture {runs:.2f}, the loop's {loops:.2f})\n"
        )
    assert whole < 3.0
