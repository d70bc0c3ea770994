"""An opponent of Poise: the same questions answered by code that shares nothing with it but the spec file.

problem.py        a spec file as numbers
simulator.c, .py  a run of the nonlinear loop, written from the paper's equations in C and called through ctypes
linear.py         poles, delay margin, disk margin and sampling period of the linear loop
judge.py          all of it as rows by the ids of `poise report`, and how far gains are from meeting a spec
random_specs.py   random specs by seed
evolution.py      a long global search over the gains of each; its answers are kept in evolution_table.json
compare.py        `poise synthesize` against that table

The tests here show that both sides say the same of the same gains. From the root of the project:

    python -m tests.independent.compare --seeds 0-9

comparison.json is what compare.py printed of all fifty, with the seconds of CPU that each took.

The table was computed once; its rows hold the spec, the best gains, the objective's value there, whether every
requirement is met, the largest violation (a part of the level), what each of three seeds came to, the number of
evaluations and CPU seconds. Values agree with those of Poise where both judge the same gains, but for one definition.
For an unequal foot, and under law cop, decay rate and delay margin are the worst of the operating points along a
scenario: 65 a piece here, 11 in Poise, so that a decay rate can be a few parts in 1e5 less here. A spec's
[uncertainty] and law.adapt_s are not known here.
"""
