"""The C code under the address and undefined-behaviour sanitizers."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from pyrobocop_pyomo.linear_solver.factorisation import LINEAR_SOLVER_NAME
from pyrobocop_pyomo.native.shared_library import library_sources

PROGRAM = Path(__file__).parent / "native" / "stress.c"
FLAGS = ["-O1", "-g", "-std=c99", "-Wall", "-Wextra", "-Werror", "-fno-omit-frame-pointer", "-pthread"]
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


def compiled(folder: Path, name: str, sources: list[Path], flags: list[str]) -> Path | None:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        return None
    command = [
        compiler,
        *flags,
        *(str(source) for source in sources if source.suffix == ".c"),
        "-o",
        str(folder / name),
        "-lm",
    ]
    return folder / name if subprocess.run(command, capture_output=True, check=False).returncode == 0 else None


@pytest.mark.heavy
def test_nothing_is_read_or_written_beside_the_arrays(tmp_path):
    empty = tmp_path / "empty.c"
    empty.write_text("int main(void) { return 0; }\n")
    if compiled(tmp_path, "empty", [empty], SANITIZERS) is None:
        pytest.skip("no C compiler with sanitizers is found")
    program = compiled(tmp_path, "stress", [PROGRAM, *library_sources(LINEAR_SOLVER_NAME)], FLAGS + SANITIZERS)
    assert program is not None, "the sources do not compile, or not without warnings"
    ended = subprocess.run([program], capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert ended.stderr == ""
    factored, refused, wrong = map(int, re.findall(r"\d+", ended.stdout))
    assert (factored + refused, wrong) == (3200, 0)
    assert factored > 500
