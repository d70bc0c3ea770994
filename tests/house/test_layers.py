"""Imports point one way, and each heavy library has one door."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [ROOT / "cli.py", *sorted((ROOT / "design").rglob("*.py")), *sorted((ROOT / "problems").rglob("*.py"))]

ALLOWED = {  # which of our packages a file of each may import
    "cli": {"design", "problems"},
    "problems": {"problems", "design"},
    "design/present": {
        "design/present",
        "design/proof",
        "design/analysis",
        "design/solvers",
        "design/recordings",
        "design/model",
        "design/spec",
        "design",
    },
    "design/analysis": {
        "design/analysis",
        "design/solvers",
        "design/recordings",
        "design/model",
        "design/spec",
        "design",
    },
    "design/checking": {"design/checking", "design"},
    "design/proof": {
        "design/proof",
        "design/checking",
        "design/analysis",
        "design/solvers",
        "design/model",
        "design/spec",
        "design",
    },
    "design/recordings": {"design/recordings", "design/model", "design"},
    "design/spec": {"design/spec", "design/model", "design"},
    "design/solvers": {"design/solvers", "design"},
    "design/model": {"design/model", "design"},
    "design": {"design"},  # its errors
}
DOORS = {
    "ezc3d": {"design/recordings/binary.py"},
    "matplotlib": {"design/present/plots.py"},
    "clarabel": {"design/solvers/conic.py"},
    "typer": {"cli.py"},
    "pydantic": {
        "design/spec/schema.py",
        "design/spec/fields.py",
        "design/spec/study_tables.py",
        "design/spec/load.py",
        "design/spec/faults.py",
    },
}


def _package(dotted: str) -> str | None:
    parts = dotted.split(".")
    if parts[0] not in ("design", "problems", "cli"):
        return None
    if parts[0] == "design" and len(parts) > 1 and (ROOT / "design" / parts[1]).is_dir():
        return f"design/{parts[1]}"
    return parts[0]


def _imports(path: Path) -> list[str]:
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            found.append(node.module or "")
    return found


def _relative(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


@pytest.mark.parametrize("path", SOURCES, ids=_relative)
def test_a_file_imports_only_what_stands_below_it(path):
    own = _package(".".join(path.relative_to(ROOT).with_suffix("").parts))
    for dotted in _imports(path):
        other = _package(dotted)
        allowed = other is None or other in ALLOWED[own] or (own in ("cli", "problems") and other.startswith("design/"))
        assert allowed, f"{_relative(path)} imports {dotted}"


@pytest.mark.parametrize("path", SOURCES, ids=_relative)
def test_each_library_comes_in_by_its_own_door(path):
    for dotted in _imports(path):
        doors = DOORS.get(dotted.split(".")[0])
        assert doors is None or _relative(path) in doors, f"{_relative(path)} imports {dotted}"


def test_only_the_solver_door_calls_ipopt():
    for path in SOURCES:
        if _relative(path) != "design/solvers/nlp.py":
            assert "nlpsol" not in path.read_text(encoding="utf-8"), _relative(path)


def test_the_command_line_is_thin():
    """A command declares its options, calls one function, prints, and ends."""
    text = (ROOT / "cli.py").read_text(encoding="utf-8")
    assert len(text.splitlines()) < 32 * text.count("@app.command")  # mostly declarations of options
    for function in ast.walk(ast.parse(text)):
        if isinstance(function, ast.FunctionDef) and any(
            "command" in ast.dump(each) for each in function.decorator_list
        ):
            assert sum(isinstance(node, ast.stmt) for node in ast.walk(function)) <= 14, function.name
