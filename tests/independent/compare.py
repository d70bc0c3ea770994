"""`poise synthesize` against the table of long global searches, each answer judged by the independent simulator.

    python -m tests.independent.compare                        # every spec of evolution_table.json
    python -m tests.independent.compare --seeds 0-4 --output rows.json

A line a spec: what Poise says, its value, the same by the independent simulator, the table's value, by how much Poise
is better in per cent, CPU seconds. Poise is *worse* if by more than 0.05 %. It is *unsure* if it says so: an answer
that not every start reached, or none. A requirement is *broken* if the independent simulator misses it by more than
5e-5 of its level, which is what the table allows itself. The time limit is one of the clock, so that on a busy machine
more answers are late.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from .evolution import TABLE, TRUSTED, seeds_of
from .judge import judge
from .problem import read

WORSE = 5e-4
BROKEN = TRUSTED


def poise(text, seconds):
    """The JSON of `poise synthesize` for a spec's text, or a stand-in with its message; and its CPU seconds."""
    program = Path(sys.executable).with_name("poise")
    with tempfile.TemporaryDirectory() as folder:
        spec = Path(folder) / "spec.toml"
        spec.write_text(text)
        command = [str(program), "synthesize", str(spec), "--format", "json", "--time-limit", str(seconds)]
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        run = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "NO_COLOR": "1"})
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    try:
        return json.loads(run.stdout), cpu
    except json.JSONDecodeError:
        last = (run.stderr.strip() or run.stdout.strip() or "nothing").splitlines()[-1]
        return {"status": f"exit {run.returncode}", "reason": last, "gains": None, "why_not": None}, cpu


def compared(row, seconds=60.0):
    """One row of the table beside what Poise answers, as a dictionary."""
    answer, cpu = poise(row["spec"], seconds)
    problem = read(row["spec"])
    result = {
        "name": row["name"],
        "objective": row["objective"],
        "status": answer["status"],
        "reason": answer["reason"],
        "poise": None,
        "independent": None,
        "table": row["value"] if row["feasible"] else None,
        "better_percent": None,
        "cpu_s": round(cpu, 2),
        "unsure": answer["status"] != "solved",
        "impossible": answer["status"] == "infeasible" or _excludes(answer.get("why_not")),
        "violation": None,
        "broken": "",
        "starts": answer.get("starts"),
    }
    if answer["gains"]:
        gains = [*answer["gains"].values(), 0.0][:3]
        verdict = judge(problem, gains)
        result["gains"] = gains
        result["poise"] = answer["objective"]["value"]
        result["independent"] = verdict.rows.get(problem.objective)
        result["violation"], result["broken"] = verdict.violation, verdict.broken
        starts = answer.get("starts") or {}
        result["unsure"] = starts.get("reached", 0) < starts.get("tried", 1)
        if row["feasible"] and result["independent"] is not None:
            sign = -1.0 if problem.minimise else 1.0
            result["better_percent"] = 100.0 * sign * (result["independent"] - row["value"]) / abs(row["value"])
    return result


def _excludes(why):
    """Whether the answer claims that requirements exclude each other."""
    return bool(why and why.get("conflict") and why.get("minimal") and why.get("complete"))


def verdict_of(result):
    """In a word or two what is wrong with an answer, or an empty string."""
    feasible = result["table"] is not None
    if result["status"] == "solved":
        if result["violation"] > BROKEN:
            return f"BROKEN {result['broken']} by {result['violation']:.1e}"
        if not feasible:
            return "table has none"
        if result["better_percent"] < -100.0 * WORSE:
            return "WORSE" + (" (unsure)" if result["unsure"] else "")
        return ""
    if feasible:
        if result["impossible"]:
            return "IMPOSSIBLE CLAIMED"
        return "time limit" if "time limit" in result["reason"].lower() else "none found"
    return ""


def line(result):
    """A line of the printed table."""
    numbers = ["-" if result[key] is None else f"{result[key]:.7g}" for key in ("poise", "independent", "table")]
    better = "-" if result["better_percent"] is None else f"{result['better_percent']:+.4f}"
    starts = result["starts"] or {}
    reached = f"{starts.get('reached', '-')}/{starts.get('tried', '-')}"
    cells = [result["name"], result["objective"], result["status"], *numbers, better, reached, f"{result['cpu_s']:.1f}"]
    widths = (-10, -14, -11, 11, 11, 11, 9, 6, 6)
    padded = [f"{cell:<{-w}}" if w < 0 else f"{cell:>{w}}" for cell, w in zip(cells, widths, strict=True)]
    return "  ".join([*padded, verdict_of(result)]).rstrip()


def summary(results):
    """What went wrong, counted."""
    verdicts = [verdict_of(each) for each in results]
    feasible = [each for each in results if each["table"] is not None]
    worse = [v for v in verdicts if v.startswith("WORSE")]
    return "\n".join(
        [
            f"{len(results)} specs, {len(feasible)} of them feasible by the table",
            f"worse by more than {100 * WORSE:g} %: {len(worse)}, of which said to be unsure:"
            f" {sum('unsure' in v for v in worse)}",
            f"nothing found where there is something: {sum(v == 'none found' for v in verdicts)}",
            f"not within the time limit: {sum(v == 'time limit' for v in verdicts)}",
            f"claimed impossible where it is not: {sum(v == 'IMPOSSIBLE CLAIMED' for v in verdicts)}",
            f"a requirement broken by the independent simulator: {sum(v.startswith('BROKEN') for v in verdicts)}",
            f"better than the table by more than {100 * WORSE:g} %:"
            f" {sum(e['better_percent'] is not None and e['better_percent'] > 100 * WORSE for e in results)}",
            f"CPU {sum(e['cpu_s'] for e in results):.0f} s",
        ]
    )


def main():
    """Print the comparison."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--table", type=Path, default=TABLE, help="JSON file of evolution.py")
    parser.add_argument("--seeds", type=seeds_of, help="only these: a-b or a,b,c")
    parser.add_argument("--time-limit", type=float, default=60.0, help="of each synthesis [s]")
    parser.add_argument("--output", type=Path, help="keep the results as JSON")
    options = parser.parse_args()
    rows = json.loads(options.table.read_text())
    if options.seeds is not None:
        names = {f"seed {seed}" for seed in options.seeds}
        rows = [row for row in rows if row["name"] in names]
    results = []
    sys.stdout.write(
        "spec        objective       status            Poise  independent       table  better %  starts   CPU s\n"
    )
    for row in rows:
        results.append(compared(row, options.time_limit))
        sys.stdout.write(line(results[-1]) + "\n")
        sys.stdout.flush()
        if options.output:
            options.output.write_text(json.dumps(results, indent=1) + "\n")
    sys.stdout.write(summary(results) + "\n")


if __name__ == "__main__":
    main()
