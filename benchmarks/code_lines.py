"""What the code weighs: lines of code per folder, and sums that only fall.

    python benchmarks/code_lines.py [--root FOLDER] [--quick | --record]

Lines are without docstrings, comments and blank lines, C included. The sums are lines of the package, of its core
(without ``contrib``) and of the tests; numbers that modules assign to names, which are tuned constants; places that
catch every exception; and private attributes of Pyomo. `tests/architecture/test_size.py` holds each sum at most one per
cent above the lowest that was recorded; ``--record`` writes down the present ones.
"""

from __future__ import annotations

import argparse
import ast
import json
import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
RECORD = ROOT / "tests" / "architecture" / "recorded_sizes.json"
_PRIVATE_OF_PYOMO = re.compile(
    r"\._(args_|data|rule|nargs|fixed|body|value|component_data|suppress_ctypes|constructed|name|index_set)\b"
)
C_FILES = (".c", ".h", ".cpp")
_CATCHES_ALL = re.compile(r"except (?:Base)?Exception\b")
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def python_code_lines(text: str) -> int:
    """Lines of a module on which something other than a docstring or a comment stands."""
    documented: set[int] = set()
    statements: list[ast.AST] = [ast.parse(text)]
    while statements:
        node = statements.pop()
        if isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            docstring = node.body[0]
            documented.update(range(docstring.lineno, (docstring.end_lineno or docstring.lineno) + 1))
        for part in ("body", "orelse", "finalbody", "handlers", "cases"):
            statements += getattr(node, part, ())
    lines = enumerate(map(str.strip, text.split("\n")), start=1)
    return sum(1 for number, line in lines if line and not line.startswith("#") and number not in documented)


def c_code_lines(text: str) -> int:
    """Lines of C on which something other than a comment stands."""
    without_blocks = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    return sum(1 for line in without_blocks.splitlines() if line.split("//")[0].strip())


def code_lines(folder: Path) -> dict[str, int]:
    """Lines of each folder directly below a folder; of the files beside these under ``"."``."""
    found: Counter[str] = Counter()
    for path in sorted(folder.rglob("*")):
        count = {".py": python_code_lines, ".c": c_code_lines, ".h": c_code_lines, ".cpp": c_code_lines}.get(
            path.suffix
        )
        if count is not None:
            first, *rest = path.relative_to(folder).parts
            found[first if rest else "."] += count(path.read_text(encoding="utf-8"))
    return dict(found)


def module_numbers(text: str) -> int:
    """How many numbers a module assigns to names at its top level."""
    return sum(
        sum(map(_is_number, value.elts)) if isinstance(value, (ast.Tuple, ast.List)) else _is_number(value)
        for node in ast.parse(text).body
        if isinstance(node, (ast.Assign, ast.AnnAssign)) and (value := node.value) is not None
    )


def _is_number(node: ast.expr) -> bool:
    if isinstance(node, ast.UnaryOp):
        return _is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return _is_number(node.left) and _is_number(node.right)
    return isinstance(node, ast.Constant) and type(node.value) in (int, float)


def sums(root: Path) -> dict[str, int]:
    """What a checkout weighs in all."""
    package, tests = code_lines(root / "pyrobocop_pyomo"), code_lines(root / "tests")
    texts = [path.read_text(encoding="utf-8") for path in (root / "pyrobocop_pyomo").rglob("*.py")]
    return {
        "package lines": sum(package.values()),
        "core lines": sum(package.values()) - package.get("contrib", 0),
        "test lines": sum(tests.values()),
        "module numbers": sum(map(module_numbers, texts)),
        "except Exception": sum(len(_CATCHES_ALL.findall(text)) for text in texts),
        "private attributes of Pyomo": sum(len(_PRIVATE_OF_PYOMO.findall(text)) for text in texts),
    }


def record() -> None:
    """Write down the sums and the lines of each folder, by which the test says what grew."""
    folders = {part: code_lines(ROOT / part) for part in ("pyrobocop_pyomo", "tests")}
    RECORD.write_text(json.dumps({"sums": sums(ROOT), "folders": folders}, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """Print the tables, or record them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, default=ROOT, help="a checkout, such as one of another commit")
    parser.add_argument("--quick", action="store_true", help="the package only")
    parser.add_argument("--record", action="store_true", help="write down what this checkout weighs")
    arguments = parser.parse_args()
    if arguments.record:
        record()
    for name, number in sums(arguments.root).items():
        print(f"{name:28} {number:7,d}")
    for part in ("pyrobocop_pyomo",) if arguments.quick else ("pyrobocop_pyomo", "tests", "benchmarks", "examples"):
        lines = code_lines(arguments.root / part)
        print(f"{part:20} {sum(lines.values()):7,d}")
        for name, number in sorted(lines.items(), key=lambda item: -item[1]):
            print(f"    {name:16} {number:7,d}")


if __name__ == "__main__":
    main()
