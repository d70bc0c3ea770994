"""A program of its own that reads the force plates of a C3D file: what crashes or bloats the reader ends this alone.

Arguments: the C3D file, the .npz file to write, and the memory [bytes] and time [s] that are allowed.
"""

from __future__ import annotations

import sys
from typing import Any

PLATE = ("force", "moment", "corners", "origin")
NO_PLATES, UNREADABLE = 4, 5
"""Exit codes; 0 if the .npz file is written."""


def limit(memory: int, seconds: int) -> None:
    """Limit this process where the system lets it."""
    try:
        import resource
    except ImportError:  # not a Unix
        return
    for kind, most in ((resource.RLIMIT_AS, memory), (resource.RLIMIT_CPU, seconds), (resource.RLIMIT_CORE, 0)):
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def read(source: str) -> dict[str, Any] | None:
    """Forces and moments (plates, 3, n) in the laboratory's frame, corners, rate, units; None without plates."""
    import ezc3d
    import numpy as np

    bare = ezc3d.c3d(source)
    parameters = bare["parameters"]

    def values(group: str, name: str) -> Any:
        return np.asarray(parameters.get(group, {}).get(name, {}).get("value", []))

    used = values("FORCE_PLATFORM", "USED").ravel()
    if not used.size or int(used[0]) < 1:
        return None
    plates = ezc3d.c3d(source, extract_forceplat_data=True)["data"]["platform"]

    def text(group: str, name: str) -> Any:
        """Texts of any number of parameters, as ANALOG:UNITS and ANALOG:UNITS2."""
        return np.array([str(each) for each in values(group, name).ravel(order="F")], dtype=str)

    return {
        **{
            key: np.array([plate[key] for plate in plates], dtype=np.float64)
            for key in ("force", "moment", "corners", "origin")
        },
        "header_rate": np.array(float(bare["header"]["analogs"]["frame_rate"])),
        "analog_rate": values("ANALOG", "RATE").astype(np.float64).ravel()[:1],
        "analog_units": text("ANALOG", "UNITS"),
        "point_units": text("POINT", "UNITS"),
        "channels": values("FORCE_PLATFORM", "CHANNEL").astype(np.int64),
    }


def main(source: str, target: str, memory: str, seconds: str) -> int:
    """Read ``source`` and write ``target``; the exit code."""
    limit(int(memory), int(seconds))
    import numpy as np

    try:
        arrays = read(source)
        if arrays is None:
            return NO_PLATES
        np.savez(target, **arrays)
    except Exception as error:  # whatever the reader raises on a damaged file
        sys.stderr.write(" ".join((str(error) or type(error).__name__).split())[:100])
        return UNREADABLE
    return 0


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
