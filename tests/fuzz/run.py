"""The whole command under random inputs: however they are, it ends as it says it does.

``python -m tests.fuzz.run --count 5000 --seed 1`` tries that many cases and keeps those that fail in a folder. Each is
a fork of one process that has loaded Poise, with limits on time and memory.
"""

from __future__ import annotations

import argparse
import base64
import json
import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import time
import unicodedata
from collections import Counter
from collections.abc import Iterator
from contextlib import redirect_stdout
from dataclasses import asdict
from io import StringIO
from pathlib import Path
from typing import NoReturn

from tests.fuzz.cases import BASE, Case, Seeds, case

SECONDS = 30.0
"""Within which every case ends [s]."""
MEGABYTES = 1500
"""Of memory that every case does with."""
CODES = {0, 1, 2, 3, 130}
LINES = 12
"""Of standard error at most: warnings on implausible numbers, and what went wrong."""


def seeds() -> Seeds:
    """Sound files, made by Poise itself."""
    import cli
    from tests.recordings.plate_files import FORMATS, Truth

    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        (place / "mine.toml").write_text(BASE)
        for arguments in (
            ["synthesize", f"{place}/mine.toml", "-o", f"{place}/design.json", "--time-limit", "20", "--starts", "1"],
            ["prove", f"{place}/mine.toml", "--scale", "0", "--certificate", f"{place}/c1.json"],
            ["prove", "slope", "--certificate", f"{place}/c2.json"],
        ):
            with redirect_stdout(StringIO()):
                cli.app(arguments, standalone_mode=False)
        certificates = [path.read_text() for path in sorted(place.glob("c?.json"))]
        design = (place / "design.json").read_text()
    recordings = [FORMATS[form](Truth(plates, "z", "x"), 1)[::2] for form in FORMATS for plates in ("1", "2")]
    assert certificates
    return Seeds(design=design, certificates=tuple(certificates), recordings=tuple(recordings))


def faults(case: Case) -> tuple[list[str], float, float]:
    """What is wrong with how ``case`` ends, the time that it took [s], and its memory [MB]."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        work = place / "work"
        work.mkdir()
        for name, content in case.files.items():
            (work / name).write_bytes(content)
        before = {os.fsencode(path) for path in work.iterdir()}
        begin = time.monotonic()
        child = os.fork()
        if not child:
            _run(case, place, work)
        code, memory = _wait(child)
        spent = time.monotonic() - begin
        out, err = ((place / name).read_bytes().decode(errors="replace") for name in ("out", "err"))
        left = [os.fsdecode(path) for path in {os.fsencode(path) for path in work.iterdir()} - before]
        found = _said(code, out, err)
        if spent > SECONDS:
            found.append(f"took {spent:.0f} s")
        if memory > MEGABYTES:
            found.append(f"took {memory:.0f} MB")
        found += _left(case, work, [Path(path).name for path in left], code)
    return found, spent, memory


def _run(case: Case, place: Path, work: Path) -> NoReturn:
    """Be the command, in this process."""
    import cli

    code = 250
    try:
        os.setsid()
        limit = int(SECONDS) + 1
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 1))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        for number, name, flags in ((0, os.devnull, os.O_RDONLY), (1, "out", os.O_RDWR), (2, "err", os.O_RDWR)):
            handle = os.open(place / name if number else name, flags | (os.O_CREAT if number else 0), 0o600)
            os.dup2(handle, number)
        os.chdir(work)
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)
        sys.stderr = open(2, "w", encoding="utf-8", closefd=False)
        sys.argv = ["poise", *case.arguments]
        cli.main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 251
    except BaseException:
        import traceback

        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except (OSError, ValueError):
                pass
        os._exit(code)


def _wait(child: int) -> tuple[int, float]:
    """How ``child`` ends, as a shell counts it, and its memory [MB]; its group is killed after the time."""
    end = time.monotonic() + SECONDS + 2
    while True:
        done, status, used = os.wait4(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status), used.ru_maxrss / 1e3
        if time.monotonic() > end:
            os.killpg(child, signal.SIGKILL)
            end += 3600
        time.sleep(0.005)


def _said(code: int, out: str, err: str) -> list[str]:
    found = []
    if code not in CODES:
        found.append(f"exit code {code}")
    for word in ("Traceback", "internal error"):
        if word in err or word in out:
            found.append(word)
    if len(err.splitlines()) > LINES:
        found.append(f"{len(err.splitlines())} lines on standard error")
    if code == 2 and not err.strip():
        found.append("exit code 2 without a word")
    for name, text in (("output", out), ("error", err)):
        odd = sorted({hex(ord(c)) for c in text if unicodedata.category(c) == "Cc" and c not in "\n\t"})
        if odd:
            found.append(f"control characters {' '.join(odd)} in standard {name}")
    return found


def _left(case: Case, work: Path, names: list[str], code: int) -> list[str]:
    """What is wrong with the files that are left: strangers, and files that are not whole."""
    found = [f"leaves {name!r}" for name in names if name not in case.outputs]
    for name in set(names) & set(case.outputs):
        content = (work / name).read_bytes().decode(errors="replace")
        if code in (2, 130) and name not in ("picture.svg", "proof.json"):
            found.append(f"writes {name} and ends with {code}")
        if name.endswith(".json") and content.lstrip().startswith("{"):
            try:
                json.loads(content, parse_constant=lambda word: 1 / 0)
            except (ValueError, ZeroDivisionError):
                found.append(f"{name} is not whole JSON")
        if content.startswith("<!") and not content.rstrip().endswith("</html>"):
            found.append(f"{name} is not whole HTML")
        if name.endswith(".xml") and content.startswith("<?xml"):
            from xml.etree import ElementTree

            try:
                ElementTree.fromstring(content)
            except ElementTree.ParseError as error:
                found.append(f"{name}: {error}")
    return found


def stored(case: Case) -> str:
    """``case`` as the text of a file of the corpus."""
    data = asdict(case)
    data["files"] = {name: _text(content) for name, content in case.files.items()}
    return json.dumps(data, indent=1) + "\n"


def _text(content: bytes) -> str | dict[str, str]:
    try:
        return content.decode()
    except UnicodeDecodeError:
        return {"base64": base64.b64encode(content).decode()}


def restored(text: str) -> Case:
    """The case in the text of a file of the corpus."""
    data = json.loads(text)
    files = {
        name: content.encode() if isinstance(content, str) else base64.b64decode(content["base64"])
        for name, content in data["files"].items()
    }
    return Case(files=files, arguments=tuple(data["arguments"]), outputs=tuple(data["outputs"]))


def load() -> None:
    """Import what the commands import, once for all forks."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"
    os.environ["MPLBACKEND"] = "agg"
    home = Path(__file__).parents[1]
    sys.path[:0] = [part for part in (str(home.parent), str(home / "recordings")) if part not in sys.path]
    import cli  # noqa: F401
    from design.present import html, opening, proving, recording, reporting, simulation  # noqa: F401
    from problems import commands  # noqa: F401


def tried(count: int, seed: int) -> Iterator[tuple[int, Case, list[str], float, float]]:
    """``count`` cases from ``seed`` on and what is wrong with each, its time [s] and memory [MB]."""
    load()
    sound = seeds()
    for number in range(count):
        each = case(sound, random.Random(f"{seed} {number}"))
        yield number, each, *faults(each)


def main() -> None:
    """Try the cases, print what fails and the extremes of time and memory."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument("--count", type=int, default=5000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, default=Path("fuzz-failures"), help="folder for the cases that fail")
    parser.add_argument("--again", type=Path, nargs="*", help="files of cases to try instead")
    asked = parser.parse_args()
    if asked.again:
        load()
        for path in asked.again:
            print(path.name, *faults(restored(path.read_text())))  # noqa: T201
        return
    shutil.rmtree(asked.keep, ignore_errors=True)
    asked.keep.mkdir()
    counts, slowest, largest = Counter[str](), 0.0, 0.0
    try:
        for number, each, found, spent, memory in tried(asked.count, asked.seed):
            counts["failed" if found else "sound"] += 1
            slowest, largest = max(slowest, spent), max(largest, memory)
            if found:
                (asked.keep / f"{asked.seed}-{number}.json").write_text(stored(each))
                print(number, each.arguments[0], "; ".join(found), flush=True)  # noqa: T201
    finally:
        print(f"{dict(counts)}, slowest {slowest:.1f} s, most memory {largest:.0f} MB")  # noqa: T201


if __name__ == "__main__":
    main()
