"""A front of 25 designs: within 30 s, and a fraction of 25 designs sought one by one."""

import sys
import time
from dataclasses import replace

from design.model.limits import Required
from design.spec.load import load
from design.spec.setting import setting
from problems import gains
from problems.tradeoff import margins, solve

SLOPE = setting(load("slope").spec)


def test_a_front_of_25_designs(benchmark, capsys):
    used = []

    def ours():
        start = time.process_time()
        found = solve(SLOPE, margins(["contact-force", "decay-rate"]), points=25).value
        used.append(time.process_time() - start)
        return found

    found = benchmark.pedantic(ours, rounds=1)
    levels = [each.values[0] for each in found.designs[1:-1:6]]
    start = time.process_time()
    for level in levels:
        required = {**SLOPE.required, "contact-force": Required(level=float(level))}
        gains.solve(replace(SLOPE, objective="decay-rate", required=required))
    alone = 25 / len(levels) * (time.process_time() - start)
    with capsys.disabled():
        sys.stdout.write(f"\n25 designs: {benchmark.stats.stats.median:.1f} s, {used[0]:.1f} s of CPU;")
        sys.stdout.write(f" 25 times synthesize {alone:.1f} s of CPU; ratio {alone / used[0]:.1f}\n")
    assert len(found.designs) == 25
    assert used[0] < 30.0
    assert alone > used[0]
