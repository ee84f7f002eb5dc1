"""What is read of `.nl` files agrees with ASL; refusals say where."""

from pathlib import Path

import numpy as np
import pyomo.environ as pyo
import pytest
from problem_files import FileProblem, read_file

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


def nl_text(rows: list[str], bounds: str = "", pairs: int = 0) -> str:
    """A file over two variables, and v2 = v0 + 2 v1 + sin(v0), with these expressions as rows."""
    m = len(rows)
    header = [
        "g3 0 1 0", f" 2 {m} 1 0 0", f" {m} 0 {pairs} 0 0 0", " 0 0", " 2 0 0", " 0 0 0 1", " 0 0 0 0 0", f" {2 * m} 1",
        " 0 0", " 1 0 0 0 0",
    ]  # fmt: skip
    body = ["V2 2 0", "0 1", "1 2", "o41", "v0"]
    for i, row in enumerate(rows):
        body += [f"C{i}", *row.split()]
    body += [
        "O0 0",
        "n0",
        "x1",
        "1 0.7",
        "r",
        *([bounds] if bounds else ["1 9"] * m),
        "b",
        "2 0",
        "0 -1 1",
        "k1",
        f"{m}",
    ]
    for i in range(m):
        body += [f"J{i} 2", "0 0", "1 0.5"]
    return "\n".join([*header, *body, "G0 1", "0 1", ""])


def read(text: str, folder: Path) -> FileProblem:
    (folder / "some.nl").write_text(text)
    return read_file(folder / "some.nl")


def bodies(problem: FileProblem) -> list[float]:
    """Values of the rows by the numbers of the file: what violates them when each has to be zero."""
    model = problem.model()
    for variable, number in zip(model.x.values(), POINT, strict=True):
        variable.set_value(float(number))
    return [pyo.value(row.body) for row in model.rows.values()]


@pytest.mark.asl
@pytest.mark.parametrize("expression", EXPRESSIONS)
def test_asl_gives_every_operator_the_same_value(expression: str, tmp_path: Path) -> None:
    problem = read(nl_text([f"o0 v0 {expression}"]), tmp_path)
    (value,) = AslProgram(tmp_path / "some.nl").constraints(POINT)
    assert bodies(problem) == [pytest.approx(value, rel=1e-12)]
    # Judged, the row is above a bound that is far below by as much as it is above it.
    low = read(nl_text([f"o0 v0 {expression}"], "1 -1e6"), tmp_path)
    assert low.check(POINT).violation == pytest.approx(value + 1e6, rel=1e-14)


@pytest.mark.parametrize(
    ("which", "x", "body", "natural"),
    [
        (1, 0.0, 2.0, 0.0), (1, 0.5, 2.0, 0.5), (1, 0.5, 0.0, 0.0), (1, 0.0, -0.25, 0.25),
        (2, 1.0, -2.0, 0.0), (2, 0.5, -2.0, 0.5), (2, 1.0, 0.25, 0.25),
        (3, 0.0, 2.0, 0.0), (3, 1.0, -2.0, 0.0), (3, 0.5, 0.0, 0.0), (3, 0.5, 0.25, 0.25),
    ],
)  # fmt: skip
def test_a_row_of_type_5_holds_where_its_definition_says(
    which: int, x: float, body: float, natural: float, tmp_path: Path
) -> None:
    """Nonnegative at the lower bound of the variable, nonpositive at the upper one, zero between."""
    text = (
        nl_text(["v0"], f"5 {which} 2", pairs=1)
        .replace("0 -1 1", "0 0 1")
        .replace("1 0.5", "1 0")
        .replace("\n2 0\n", "\n3\n")
    )
    problem = read(text, tmp_path)
    assert problem.check([body, x]).natural == natural
    model = problem.model()
    assert len(model.pairs) == 1
    assert len(model.rows) == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("o0\nv0\nv1", "o48\nv0\nv1"), r"line 17: the operator o48 is not known"),
        (("\nO0 0", "\nL0\nO0 0"), "'L' begins no segment"),
        (("\n 0 0 0 0 0\n", "\n 1 0 0 0 0\n"), "1 of its 2 variables are discrete"),
        (("g3 0 1 0", "c3"), "is no .nl file"),
        (("1 9", "5 1 3"), "row 0 cannot be complementary to bounds 1 of variable 2"),
        (("1 9", "5 2 1"), "row 0 is complementary to the upper bound of variable 0, which has none"),
        (("G0 1\n0 1\n", "G0 1\n0"), "cannot be read"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_with_its_place(change: tuple[str, str], message: str, tmp_path: Path) -> None:
    text = nl_text(["o0 v0 v1"])
    assert change[0] in text
    with pytest.raises(ModelError, match=message):
        read(text.replace(*change, 1), tmp_path)
