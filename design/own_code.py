"""A process that has the code it runs to itself, and not in the same memory as the process on the next core.

The system keeps one copy of a library's code for all processes that run it. On some machines two cores that fetch the
same code slow each other: on the virtual machine on which this was found, two workers of a study without any shared
data did 1.7 times the work of one, and 1.9 times with a copy of the code each. A page that is private to the process
is copied by the kernel when it is written to; each is written with a byte that it holds, so that it stays as it was.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

PRESENT, FROM_FILE = np.uint64(1 << 63), np.uint64(1 << 61)
"""Bits of an entry of /proc/PID/pagemap (Linux, admin-guide/mm/pagemap): in memory; still the file's own page."""


def own_code() -> int:
    """Copy the code that this process has run so far; how many pages it copied.

    0 where the system does not let it, as anywhere but on Linux. Safe while other threads run, and to be repeated: only
    what was run since is copied.
    """
    page = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 0
    copied = 0
    try:
        maps = Path("/proc/self/maps").read_text(encoding="utf-8", errors="replace")
        with open("/proc/self/pagemap", "rb", 0) as pagemap, open("/proc/self/mem", "r+b", 0) as memory:
            for first, after in _code(maps):
                pagemap.seek(first // page * 8)
                entries = np.frombuffer(pagemap.read((after - first) // page * 8), dtype=np.uint64)
                shared = (entries & PRESENT != 0) & (entries & FROM_FILE != 0)
                for place in (first + page * np.flatnonzero(shared)).tolist():
                    memory.seek(place)
                    byte = memory.read(1)
                    memory.seek(place)
                    memory.write(byte)
                    copied += 1
    except OSError:
        pass
    return copied


def _code(maps: str) -> list[tuple[int, int]]:
    """Where code of files lies, by lines of /proc/PID/maps: addresses, permissions, offset, device, inode, path."""
    found = []
    for line in maps.splitlines():
        addresses, permissions, *_, path = [*line.split(maxsplit=5), ""][:6]
        if permissions == "r-xp" and path.startswith("/"):
            first, after = addresses.split("-")
            found.append((int(first, 16), int(after, 16)))
    return found
