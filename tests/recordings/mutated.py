"""Recordings with random damage, from a seed: what is read must be finite, what is refused one line.

``python tests/recordings/mutated.py [SEED [COUNT]]`` tries COUNT (2000) of them, and ends with what it saw.
"""

import random
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

TOKENS = [
    b"nan", b"inf", b"-", b"1e308", b"1e-320", b"3.4e38", b"9" * 400, b'"', b"\0", b"\xff", b"\n", b"\r", b",", b";",
    b"\t", b"Fz", b"COPx", b"[N]", b"+", b"=", b"0", b"-1", b"e", b"\xe2\x80\xae", b"\x1b[2J", b"\xef\xbb\xbf",
]  # fmt: skip
WAYS = [
    {}, {}, {}, {"allow_gaps": True}, {"rate": 100.0}, {"forward": "y"}, {"resample": 50.0}, {"origins": "0.1,0.2"},
    {"columns": "fz=2,cop=3"}, {"columns": "fz=Fz1+Fz2,cop=COPx1+COPx2"}, {"columns": "fz=-Fz1"},
    {"columns": "my=none"}, {"columns": "time=1"}, {"columns": "my=My1:N mm"},
]  # fmt: skip


def mutate(content, chance):
    """The bytes with one to twenty faults, half of them in the header."""
    changed = bytearray(content)
    for _ in range(chance.choice([1, 1, 2, 5, 20])):
        at = chance.randrange(len(changed) + 1 if chance.random() < 0.5 else min(len(changed), 1500) + 1)
        what = chance.random()
        if what < 0.3:
            changed[at : at + chance.choice([0, 1, 5])] = chance.choice(TOKENS)
        elif what < 0.5:
            del changed[at : at + chance.choice([1, 3, 50, 500])]
        elif what < 0.7:
            other = chance.randrange(len(changed) + 1)
            changed[at:at] = changed[other : other + chance.choice([10, 200, 3000])]
        elif what < 0.9 and at < len(changed):
            changed[at] = chance.randrange(256)
        else:
            del changed[at:]
    return bytes(changed) or b"x"


def tried(content, suffix, chance, folder):
    """Read mutated ``content``; "read" or "refused", and an AssertionError or whatever else went wrong."""
    from design.errors import BadInput
    from design.model.body import Biped
    from design.recordings.reading import Reading
    from design.recordings.record import open_record

    path = Path(folder) / f"mutated{suffix}"
    path.write_bytes(content)
    body = Biped(M=68.0, L=0.92, I=70.0, m=2.0, ell=0.12)
    try:
        record = open_record(str(path), Reading(**chance.choice(WAYS)), body, given=chance.random() < 0.7)
    except BadInput as refused:
        assert str(refused).isprintable()
        return "refused"
    for values in (record.load, record.cop, record.F_T, record.horizontal):
        assert values is None or np.isfinite(values[record.valid]).all()
    assert all(line.isprintable() for line in (*record.notes, *record.assumed, *record.warnings))
    return "read"


def main(seed=1, count=2000):
    """Try them; the slowest and the memory are printed beside the counts."""
    import resource

    sys.path[:0] = [str(Path(__file__).parents[2]), str(Path(__file__).parent)]
    from plate_files import FORMATS, Truth

    chance, counts, slowest = random.Random(seed), Counter(), 0.0
    contents = [(*FORMATS[form](Truth(plates, "z", "x"), 1),) for form in FORMATS for plates in ("1", "2")]
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(count):
            content, _, name = chance.choice(contents)
            begin = time.monotonic()
            counts[tried(mutate(content, chance), Path(name).suffix, chance, folder)] += 1
            slowest = max(slowest, time.monotonic() - begin)
    peak = max(resource.getrusage(who).ru_maxrss for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    sys.stdout.write(f"{dict(counts)}, slowest {slowest:.1f} s, peak {peak / 1e3:.0f} MB\n")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
