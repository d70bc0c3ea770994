"""What Poise runs on: versions, optional parts, a self-test, and a bug report that names no folder of the user."""

from __future__ import annotations

import importlib.util
import os
import platform
import re
import shutil
import sys
import traceback
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from design import __version__
from design.errors import BadInput

EXTRAS = {"c3d": "ezc3d", "cluster": "distributed"}
"""The module that each optional extra brings."""
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")
COMPILERS = ("cc", "gcc", "clang")
LEAST_HEEL_N = 29.5417
"""The smallest heel force of the paper's ramp with the paper's gains, RK4 at 1 ms, as independent code has it."""


class Requirement(NamedTuple):
    """A package that Poise needs, the least version, and the one that is there, if any."""

    name: str
    least: str
    installed: str | None

    @property
    def met(self) -> bool:
        """Whether it is there and new enough."""
        return self.installed is not None and _numbers(self.installed) >= _numbers(self.least)


def requirements() -> list[Requirement]:
    """The packages that the installed distribution asks for, without its extras."""
    try:
        lines = metadata.requires("poise") or []
    except metadata.PackageNotFoundError:  # a checkout that was never installed
        lines = []
    wanted = [re.match(r"([\w.-]+)>=([\d.]+)", line) for line in lines if "extra ==" not in line]
    return [Requirement(match[1], match[2], _installed(match[1])) for match in wanted if match]


def check_versions() -> None:
    """Raise ``BadInput`` for the first package that is missing or too old."""
    for package in requirements():
        if not package.met:
            message = f"is {package.installed or 'missing'}; Poise needs at least {package.least}; pip install -U poise"
            raise BadInput(message, key=package.name)


def examination(cores: int) -> tuple[str, bool]:
    """Lines about this installation, and whether it is sound: every package new enough, the self-test right."""
    packages = requirements()
    lines = [
        f"poise {__version__}, Python {platform.python_version()}, {platform.system()} {platform.machine()}, "
        f"{cores} core{'s' * (cores != 1)}"
    ]
    lines += [
        f"  {package.name:12} {package.installed or 'missing':12} {'ok' if package.met else f'needs {package.least}'}"
        for package in packages
    ]
    for extra, module in EXTRAS.items():
        there = importlib.util.find_spec(module) is not None
        lines.append(f"  extra {extra:9} " + ("installed" if there else f"not installed: pip install 'poise[{extra}]'"))
    for kind, names in (("compiler", COMPILERS), ("browser", BROWSERS)):
        name = next((name for name in names if shutil.which(name)), None)
        lines.append(f"  {kind:15} {name or 'none'}")
    heel = _self_test()
    right = abs(heel - LEAST_HEEL_N) < 1e-3
    lines.append(
        f"self-test: the paper's ramp leaves {heel:.4f} N on the heel, {LEAST_HEEL_N} N expected: "
        + ("right" if right else "WRONG")
    )
    return "\n".join(lines) + "\n", right and all(package.met for package in packages)


def _self_test() -> float:
    from design.analysis.simulate import simulate
    from design.spec.load import load
    from design.spec.setting import setting

    problem = setting(load("slope").spec)
    run = simulate(problem.loop(), problem.scenarios[0], problem.given_gains(), problem.step)
    return float(run.F_H.min())


def bug_report(error: BaseException, arguments: list[str]) -> str:
    """Versions, the command and the traceback of ``error``, with files by name only."""
    frames = [
        f"  {_anonymous(frame.filename)}:{frame.lineno} in {frame.name}"
        for frame in traceback.extract_tb(error.__traceback__)
    ]
    command = " ".join(Path(argument).name if os.sep in argument else argument for argument in arguments)
    versions = [f"{package.name} {package.installed}" for package in requirements()]
    what = _without_folders(f"{type(error).__name__}: {error}")
    head = [f"command: poise {command}", f"poise {__version__}, Python {sys.version.split()[0]}, {platform.system()}"]
    return "\n".join([*head, ", ".join(versions), "traceback:", *frames, what]) + "\n"


def _anonymous(file: str) -> str:
    """A source file by its place within its package."""
    parts = Path(file).parts
    for home in ("site-packages", "design", "problems"):
        if home in parts:
            start = len(parts) - 1 - parts[::-1].index(home)
            return "/".join(parts[start + (home == "site-packages") :])
    return parts[-1]


def _without_folders(text: str) -> str:
    return re.sub(r"(?:[A-Za-z]:)?(?:[\\/][^\\/\s'\":]+)+[\\/]([^\\/\s'\":]+)", r"\1", text)


def _installed(name: str) -> str | None:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return None


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version)[:3])
