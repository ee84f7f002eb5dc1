"""What is read of `.nl` files agrees with ASL."""

from pathlib import Path

import numpy as np
import pyomo.environ as pyo
import pytest
from problem_files import read_file

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.programs.asl_program import AslProgram

POINT = np.array([0.3, 0.7])
EXPRESSIONS = (
    "o0 v0 v1", "o1 v0 v1", "o2 v0 v1", "o3 v0 v1", "o5 v0 v1", "o13 v0", "o14 v0", "o15 o16 v0", "o37 v0", "o38 v0",
    "o39 v0", "o40 v0", "o41 v0", "o42 v0", "o43 v0", "o44 v0", "o45 v0", "o46 v0", "o49 v0", "o51 v0", "o53 v0",
    "o54 3 v0 n2 v1", "o5 v0 n2", "o5 n2 v0",
    "o11 2 v0 v1", "o12 3 v0 v1 n0.5", "o47 v0", "o50 v0", "o52 o0 n1 v0",
    "o6 v0 v1", "o6 v1 v0", "o35 o22 v0 v1 v0 n5", "o35 o23 v1 v0 v0 n5", "o35 o28 v0 v1 v0 n5", "o35 o29 v1 v0 v0 n5",
    "o35 o34 o22 v0 v1 v0 n5", "o35 o24 v0 v1 n1 n5", "v2",
)  # fmt: skip


def nl_text(rows: tuple[str, ...]) -> str:
    """A file over two variables, and v2 = v0 + 2 v1 + sin(v0), with these expressions as rows."""
    m = len(rows)
    header = [
        "g3 0 1 0", f" 2 {m} 1 0 0", f" {m} 0 0 0 0 0", " 0 0", " 2 0 0", " 0 0 0 1", " 0 0 0 0 0", f" {2 * m} 1",
        " 0 0", " 1 0 0 0 0",
    ]  # fmt: skip
    body = ["V2 2 0", "0 1", "1 2", "o41", "v0"]
    for i, row in enumerate(rows):
        body += [f"C{i}", *row.split()]
    body += ["O0 0", "n0", "r", *["1 9"] * m, "b", "3", "0 -1 1", "k1", f"{m}"]
    for i in range(m):
        body += [f"J{i} 2", "0 0", "1 0.5"]
    return "\n".join([*header, *body, "G0 1", "0 1", ""])


@pytest.mark.asl
def test_asl_gives_every_operator_the_same_value(tmp_path: Path) -> None:
    (tmp_path / "some.nl").write_text(nl_text(EXPRESSIONS))
    model = read_file(tmp_path / "some.nl").model()
    for variable, number in zip(model.x.values(), POINT, strict=True):
        variable.set_value(float(number))
    found = [pyo.value(row.body) for row in model.rows.values()]
    assert found == pytest.approx(AslProgram(tmp_path / "some.nl").constraints(POINT), rel=1e-12)


def test_an_operator_that_is_not_known_is_refused_with_its_place(tmp_path: Path) -> None:
    (tmp_path / "some.nl").write_text(nl_text(("o48 v0 v1",)))
    with pytest.raises(ModelError, match=r"line 17: the operator o48 is not known"):
        read_file(tmp_path / "some.nl")
