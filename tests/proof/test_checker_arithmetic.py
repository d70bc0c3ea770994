"""The checker's arithmetic holds what it stands for, and a checker that is changed anywhere is caught."""

import ast
import copy
import json
import signal
import sys
from fractions import Fraction
from pathlib import Path
from types import ModuleType

import checker_arithmetic
import pytest
from certificate_cases import tampered, true_ones, weaker

from design.checking import balls, linear, tube

FOLDER = Path(__file__).resolve().parents[2] / "design" / "checking"
ORDER = ("__init__", "balls", "linear", "world", "tube", "verdict")
TREES = {name: ast.parse((FOLDER / f"{name}.py").read_text(encoding="utf-8")) for name in ORDER}


def test_sums_products_and_bounds_hold():
    checker_arithmetic.check_balls(balls, rounds=40)


def test_constants_roots_and_reciprocals_hold():
    checker_arithmetic.check_numbers(balls)


def test_sine_and_cosine_hold_those_of_mpmath():
    checker_arithmetic.check_sines(balls)


def test_poles_and_definiteness_are_those_of_numpy():
    checker_arithmetic.check_linear(linear)


def test_the_edge_of_a_wide_tube_lies_within_its_bounds():
    checker_arithmetic.check_tube(tube)


def test_blocks_that_drive_each_other_stay_within_their_bounds():
    checker_arithmetic.check_blocks(tube)


def test_each_way_in_which_a_state_that_is_off_moves_the_load_is_counted():
    checker_arithmetic.check_errors(tube)


def test_numbers_are_read_as_they_are_written():
    assert balls.decimal("0.1") == Fraction(1, 10)
    for bad in ("nan", "inf", "1e999999999", "1" * 3000):
        with pytest.raises(ValueError):
            balls.decimal(bad)


# ---- mutants

OPPOSITE = {
    ast.Lt: ast.GtE, ast.GtE: ast.Lt, ast.Gt: ast.LtE, ast.LtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.In: ast.NotIn, ast.NotIn: ast.In, ast.Is: ast.IsNot, ast.IsNot: ast.Is,
}  # fmt: skip
SWAPPED = {"max": "min", "min": "max", "any": "all", "all": "any"}


LIMITS = ("LARGEST", "FORMAT", "CUTS", "ATTEMPTS", "DEEPEST")
"""Of size and effort: any serve."""


def _places(tree):
    """Nodes that may be changed, with what becomes of each: not texts, types, defaults of records, or limits."""
    passed = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr | ast.AnnAssign | ast.arguments):
            passed.update(map(id, ast.walk(node)))
        if isinstance(node, ast.FunctionDef) and node.name in ("content_of", "check"):
            passed.update(map(id, ast.walk(node)))
        if isinstance(node, ast.FunctionDef) and node.returns is not None:
            passed.update(map(id, ast.walk(node.returns)))
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") in LIMITS:
            passed.update(map(id, ast.walk(node)))
        if isinstance(node, ast.Assign) and getattr(node.targets[0], "attr", "") in ("law", "left_out", "name"):
            passed.update(map(id, ast.walk(node)))
    for number, node in enumerate(ast.walk(tree)):
        if id(node) in passed:
            continue
        if isinstance(node, ast.Compare):
            yield number, "comparison turned"
        elif isinstance(node, ast.BinOp) and not isinstance(node.op, ast.BitOr):
            yield number, "right term dropped"
            if isinstance(node.op, ast.Add | ast.Sub):
                yield number, "sign turned"
        elif isinstance(node, ast.UnaryOp):
            yield number, "sign dropped"
        elif isinstance(node, ast.BoolOp):
            yield number, "first condition only"
            yield number, "and for or"
        elif isinstance(node, ast.Constant) and type(node.value) is int:
            yield number, "one more"
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") == "need":
            yield number, "check dropped"
        elif isinstance(node, ast.Call) and getattr(node.func, "id", "") in SWAPPED:
            yield number, "least for largest"


def _mutated(tree, number, kind):
    tree = copy.deepcopy(tree)
    target = list(ast.walk(tree))[number]
    if kind == "comparison turned":
        target.ops[0] = OPPOSITE[type(target.ops[0])]()
    elif kind == "sign turned":
        target.op = ast.Sub() if isinstance(target.op, ast.Add) else ast.Add()
    elif kind == "one more":
        target.value += 1
    elif kind == "and for or":
        target.op = ast.Or() if isinstance(target.op, ast.And) else ast.And()
    elif kind == "least for largest":
        target.func.id = SWAPPED[target.func.id]
    elif kind == "check dropped":
        target.args[0] = ast.Constant(True)
    else:
        part = {"right term dropped": "left", "sign dropped": "operand"}.get(kind)
        put = target.values[0] if part is None else getattr(target, part)
        for node in ast.walk(tree):
            for field, value in ast.iter_fields(node):
                if value is target:
                    setattr(node, field, put)
                elif isinstance(value, list) and any(each is target for each in value):
                    setattr(node, field, [put if each is target else each for each in value])
    return ast.fix_missing_locations(tree)


def loaded(name, tree):
    """The checker's modules by name, with ``tree`` for one of them."""
    names = {each: "design.checking" if each == "__init__" else f"design.checking.{each}" for each in ORDER}
    kept = {full: sys.modules.get(full) for full in names.values()}
    found = {}
    try:
        for each, full in names.items():
            module = found[each] = ModuleType(full)
            module.__path__ = []
            sys.modules[full] = module
            exec(compile(tree if each == name else TREES[each], each, "exec"), module.__dict__)
    finally:
        sys.modules.update({full: module for full, module in kept.items() if module is not None})
    return found


def _cases():
    """Texts and whether they are to be confirmed, the quick and telling ones first; boxes are left to the others."""
    cases = [(text, True) for text in true_ones()]
    cases += [(text, False) for text in tampered().values()]
    return cases + [(text, True) for text in weaker().values()]


def killed(name, tree, cases, seconds=60.0):
    """Whether what is known of the checker tells this one from it; one that does not end is told, too."""

    def late(number, frame):
        raise TimeoutError

    def given_time(text):
        signal.setitimer(signal.ITIMER_VIRTUAL, seconds)  # of its own, however busy the machine is
        return text.encode()

    before = signal.signal(signal.SIGVTALRM, late)
    signal.setitimer(signal.ITIMER_VIRTUAL, seconds)
    try:
        modules = loaded(name, tree)
        if name in ("__init__", "balls"):
            checker_arithmetic.check_balls(modules["balls"])
            checker_arithmetic.check_numbers(modules["balls"])
            checker_arithmetic.check_sines(modules["balls"])
        if name in ("__init__", "linear"):
            checker_arithmetic.check_linear(modules["linear"])
        if name == "tube":
            checker_arithmetic.check_tube(modules["tube"])
            checker_arithmetic.check_errors(modules["tube"])
            checker_arithmetic.check_blocks(modules["tube"])
        first = cases[0][0]
        for digest, truth in ((json.loads(first)["spec"]["sha256"], True), ("0" * 64, False)):
            answer = modules["verdict"].check(given_time(first), sha256=digest)
            if answer.confirmed != truth or "not the spec" in answer.law or answer.parts != int(truth):
                return True
        return any(modules["verdict"].check(given_time(text)).confirmed != truth for text, truth in cases)
    except Exception:
        return True
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


def survivors(every=1):
    """How many mutants there are, and those that nothing tells from the checker."""
    cases = _cases()
    count, left = 0, []
    for name in ORDER:
        for number, kind in list(_places(TREES[name]))[::every]:
            count += 1
            tree = _mutated(TREES[name], number, kind)
            if not killed(name, tree, cases):
                node = list(ast.walk(TREES[name]))[number]
                left.append(f"{name}:{getattr(node, 'lineno', 0)}: {kind}: {ast.unparse(node)[:70]}")
    return count, left


def test_the_checker_as_it_is_survives():
    cases = [(text, True) for text in true_ones()[:2]]
    assert not killed("balls", TREES["balls"], cases)
    assert not killed("linear", TREES["linear"], cases)


@pytest.mark.slow
def test_a_changed_checker_is_caught():
    count, left = survivors(every=97)
    # some of those left are no faults: a bound made wider, a check that another one repeats, a limit of size
    assert len(left) < 0.25 * count, left
