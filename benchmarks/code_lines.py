"""Lines of code per folder: without docstrings, comments and blank lines, C included.

    python benchmarks/code_lines.py [--root FOLDER] [--quick]

`tests/architecture/test_size.py` holds each folder of the package and of the tests below its budget, which only falls.
"""

from __future__ import annotations

import argparse
import ast
import re
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
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
        count = {".py": python_code_lines, ".c": c_code_lines, ".h": c_code_lines}.get(path.suffix)
        if count is not None:
            first, *rest = path.relative_to(folder).parts
            found[first if rest else "."] += count(path.read_text(encoding="utf-8"))
    return dict(found)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, default=ROOT, help="a checkout, such as one of another commit")
    parser.add_argument("--quick", action="store_true", help="the package only")
    arguments = parser.parse_args()
    for part in ("pyrobocop_pyomo",) if arguments.quick else ("pyrobocop_pyomo", "tests", "benchmarks", "examples"):
        lines = code_lines(arguments.root / part)
        print(f"{part:20} {sum(lines.values()):7,d}")
        for name, number in sorted(lines.items(), key=lambda item: -item[1]):
            print(f"    {name:16} {number:7,d}")


if __name__ == "__main__":
    main()
