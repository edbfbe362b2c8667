"""The layout's own rules: imports run one way, files stay short, importing stays light."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "src" / "levelhead"

# A package may import those before it and itself; the first row is the ground that everybody stands on.
ORDER = ("ground", "kernel", "estimators", "logs", "sim", "analysis", "preflight", "report", "cli")
GROUND = {"conventions", "earth", "errors", "events", "atomic", "version"}
# The front doors, which see everything.
DOORS = {"__init__", "__main__"}


def level(module: str) -> int | None:
    """Return a module's place in the order, None for the front doors."""
    parts = module.split(".")[1:]
    if not parts or parts[0] in DOORS:
        return None
    return 0 if parts[0] in GROUND else ORDER.index(parts[0])


def imports(path: Path) -> list[str]:
    """Return the modules of the package that a file imports, wherever in the file."""
    found = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "levelhead":
            found.append(node.module)
        elif isinstance(node, ast.Import):
            found += [alias.name for alias in node.names if alias.name.split(".")[0] == "levelhead"]
    return found


def test_imports_run_one_way() -> None:
    wrong = []
    for path in PACKAGE.rglob("*.py"):
        module = ".".join(("levelhead", *path.relative_to(PACKAGE).with_suffix("").parts))
        own = level(module)
        if own is None:
            continue
        for other in imports(path):
            theirs = level(other)
            if theirs is None or theirs > own:
                wrong.append(f"{module} imports {other}")
    assert wrong == []


@pytest.mark.parametrize("suffix", [".py", ".hpp", ".cpp", ".js"])
def test_files_stay_short(suffix: str) -> None:
    files = [p for folder in ("src", "tests", "benchmarks", "examples") for p in (ROOT / folder).rglob(f"*{suffix}")]
    long = {str(p.relative_to(ROOT)): n for p in files if (n := len(p.read_text(encoding="utf-8").splitlines())) > 500}
    assert {name: n for name, n in long.items() if not name.endswith(".min.js")} == {}


def test_importing_loads_nothing_heavy() -> None:
    # The promise is 0.3 s; what breaks it is a heavy library at the top of a file, which shows without a clock.
    code = "import sys, levelhead; print(*sorted(m for m in sys.modules if '.' not in m))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert {"pyarrow", "pandas", "scipy", "rich", "typer", "numba"}.isdisjoint(done.stdout.split())


def test_the_stub_names_what_the_kernel_has() -> None:
    from levelhead.kernel import _kernel

    stub = ast.parse((PACKAGE / "kernel" / "_kernel.pyi").read_text(encoding="utf-8"))
    classes = {node.name: node for node in stub.body if isinstance(node, ast.ClassDef)}
    assert {name for name in classes if not name.startswith("_")} == {
        n for n in dir(_kernel) if n.endswith(("32", "64"))
    }

    def declared(name: str) -> set[str]:
        own = {item.name for item in classes[name].body if isinstance(item, ast.FunctionDef)}
        inherited = [declared(base.id) for base in classes[name].bases if isinstance(base, ast.Name)]
        return {n for n in own.union(*inherited) if not n.startswith("__")}

    for name in (n for n in classes if not n.startswith("_")):
        assert declared(name) == {n for n in dir(getattr(_kernel, name)) if not n.startswith("__")}, name
