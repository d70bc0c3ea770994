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
"""
