"""A worker's own copy of its code: the same bytes, no longer the file's pages, and nothing where it is refused."""

import builtins
import sys

import pytest

from design.own_code import _code, own_code
from design.spec.load import load
from design.spec.setting import setting
from design.workers import processes
from problems.comparison.study import Case, Task, perform

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="/proc is Linux's")


def _before_and_after():
    """In a worker: the pages copied, those copied at once again, and the files whose code is not what it was."""
    import casadi as ca

    def value():
        x = ca.SX.sym("x")
        return float(ca.Function("f", [x], [ca.sin(x) * ca.exp(x)])(0.3))

    expected = value()
    first, again = own_code(), own_code()
    differing = []
    with open("/proc/self/maps") as maps, open("/proc/self/mem", "rb", 0) as memory:
        for line in maps:
            fields = line.split(maxsplit=5)
            if len(fields) < 6 or "x" not in fields[1] or not fields[5].startswith("/"):
                continue
            start, end = (int(place, 16) for place in fields[0].split("-"))
            memory.seek(start)
            held = memory.read(end - start)
            with open(fields[5].rstrip("\n"), "rb") as file:
                file.seek(int(fields[2], 16))
                if not held.startswith(file.read(end - start)):  # past the file's end memory is zero
                    differing.append(fields[5])
    return first, again, differing, value() == expected


@LINUX
def test_a_worker_gets_its_own_code_once_and_the_code_is_what_the_files_hold():
    with processes(1) as pool:
        first, again, differing, same = pool.submit(_before_and_after).result()
    assert first > 100  # an interpreter and CasADi are megabytes
    assert again < 0.02 * first  # copying ran a little code for the first time
    assert differing == []
    assert same


@LINUX
def test_a_worker_of_a_study_has_its_code_to_itself_from_its_first_row_on():
    source = load("slope")
    case = Case(text=source.text, seed=0, gains=(("force", setting(source.spec).gains),))
    task = Task(controller="force", scenario=setting(source.spec).scenarios[0].name, trial=0)
    with processes(1) as pool:
        assert pool.submit(perform, case, task).result()["status"] == "kept"
        left = pool.submit(own_code).result()
    with processes(1) as pool:
        pool.submit(_row_of_its_own, case, task).result()
        unowned = pool.submit(own_code).result()
    assert left < 0.02 * unowned


def _row_of_its_own(case, task):
    """The row, by what ``perform`` calls: the pages stay the files'."""
    from problems.comparison.study import _perform

    return _perform(case, task)


@pytest.mark.parametrize("refused", ["/proc/self/pagemap", "/proc/self/mem"])
def test_a_system_that_refuses_leaves_everything_as_it_was(monkeypatch, refused):
    real = builtins.open

    def guarded(path, *arguments, **options):
        if path == refused:
            raise PermissionError(path)
        return real(path, *arguments, **options)

    monkeypatch.setattr(builtins, "open", guarded)
    assert own_code() == 0


def test_only_private_code_of_files_is_taken():
    maps = (
        "00001000-00003000 r-xp 00000000 08:01 12 /usr/lib/lib with a space.so\n"
        "00003000-00004000 r--p 00002000 08:01 12 /usr/lib/lib with a space.so\n"
        "00004000-00005000 rw-p 00003000 08:01 12 /usr/lib/lib with a space.so\n"
        "00005000-00006000 r-xs 00000000 08:01 13 /dev/shared\n"
        "00006000-00007000 r-xp 00000000 00:00 0\n"
        "00007000-00008000 r-xp 00000000 00:00 0 [vdso]\n"
    )
    assert _code(maps) == [(0x1000, 0x3000)]
