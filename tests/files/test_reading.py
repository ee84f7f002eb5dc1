"""What is read of `.nl` files agrees with two other readers, ASL and CasADi; refusals say where."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pyomo.environ as pyo
import pytest
from mpcc_catalogue.point_check import check_point
from pyomo import mpec
from pyomo.contrib.pynumero.interfaces.ampl_nlp import AmplNLP

from pyrobocop_pyomo.errors import ContradictionError, ModelError
from pyrobocop_pyomo.files import FileProblem, read_file
from pyrobocop_pyomo.programs.asl_program import AslProgram
from pyrobocop_pyomo.programs.casadi_program import CasadiProgram

from .points import COLLECTION, OPTIMA

POINT = np.array([0.3, 0.7])
KNOWN_TO_CASADI = (
    "o0 v0 v1", "o1 v0 v1", "o2 v0 v1", "o3 v0 v1", "o5 v0 v1", "o13 v0", "o14 v0", "o15 o16 v0", "o37 v0", "o38 v0",
    "o39 v0", "o40 v0", "o41 v0", "o42 v0", "o43 v0", "o44 v0", "o45 v0", "o46 v0", "o49 v0", "o51 v0", "o53 v0",
    "o54 3 v0 n2 v1", "o5 v0 n2", "o5 n2 v0",
)  # fmt: skip
MORE = (
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
@pytest.mark.parametrize("expression", [*KNOWN_TO_CASADI, *MORE])
def test_asl_gives_every_operator_the_same_value(expression: str, tmp_path: Path) -> None:
    problem = read(nl_text([f"o0 v0 {expression}"]), tmp_path)
    (value,) = AslProgram(tmp_path / "some.nl").constraints(POINT)
    assert bodies(problem) == [pytest.approx(value, rel=1e-12)]
    # Judged, the row is above a bound that is far below by as much as it is above it.
    low = read(nl_text([f"o0 v0 {expression}"], "1 -1e6"), tmp_path)
    assert low.check(POINT).violation == pytest.approx(value + 1e6, rel=1e-14)


@pytest.mark.casadi
@pytest.mark.parametrize("expression", KNOWN_TO_CASADI)
def test_casadi_gives_it_too(expression: str, tmp_path: Path) -> None:
    problem = read(nl_text([expression]), tmp_path)
    assert bodies(problem) == [
        pytest.approx(value, rel=1e-12) for value in CasadiProgram(tmp_path / "some.nl").constraints(POINT)
    ]


def test_whole_numbers_are_short_or_long(tmp_path: Path) -> None:
    problem = read(nl_text(["o0 v0 s-3", "o0 v0 l70000"]), tmp_path)
    assert bodies(problem) == pytest.approx([0.3 - 3 + 0.35, 0.3 + 70000 + 0.35])


def test_a_branch_that_is_not_chosen_need_not_have_a_value(tmp_path: Path) -> None:
    problem = read(nl_text(["o35 o29 v1 v0 v0 o43 o16 v0"]), tmp_path)
    assert problem.check([0.3, 0.7]).violation == 0.0
    assert problem.check([0.7, 0.3]).violation == np.inf


def binary(text: str, order: str = "<") -> bytes:
    """A text file as a binary one."""
    lines = [line.split("#")[0].split() for line in text.split("\n")]
    header = [*lines[:10]]
    header[0][0] = header[0][0].replace("g", "b")
    header[5] = ["0", "0", "1" if order == "<" else "2", "1"]
    content = "".join(" ".join(line) + "\n" for line in header).encode()
    kind = ""
    for line in filter(None, lines[10:]):
        first, rest = line[0], line[1:]
        if first[0].isalpha() and first[0] not in "onvsl":
            kind = first[0]
        if not first[0].isalpha():
            if kind in "rb":
                layout = "ii" if first == "5" else "d" * len(rest)
                content += first.encode() + struct.pack(
                    order + layout, *(map(int, rest) if first == "5" else map(float, rest))
                )
            elif len(line) == 2:
                content += struct.pack(order + "id", int(first), float(rest[0]))
            else:
                content += struct.pack(order + "i", int(first))
        elif first[0] in "ns":
            content += first[:1].encode() + struct.pack(
                order + ("d" if first[0] == "n" else "h"), (float if first[0] == "n" else int)(first[1:])
            )
        else:
            numbers = [int(word) for word in (first[1:], *rest) if word]
            content += first[:1].encode() + struct.pack(f"{order}{len(numbers)}i", *numbers)
    return content


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("name", OPTIMA)
def test_binary_files_say_the_same(name: str, order: str, tmp_path: Path) -> None:
    text = COLLECTION / f"{name}.nl"
    (tmp_path / text.name).write_bytes(binary(text.read_text(), order))
    from_text, from_binary = read_file(text), read_file(tmp_path / text.name)
    assert (from_text.lower, from_text.upper, from_text.start) == (
        from_binary.lower,
        from_binary.upper,
        from_binary.start,
    )
    point = [0.1 + 0.3 * i for i in range(len(from_text.variables))]
    assert from_text.check(point) == from_binary.check(point)


@pytest.mark.asl
@pytest.mark.casadi
def test_other_readers_take_the_binary_file_of_these_tests(tmp_path: Path) -> None:
    """So it is no invention of theirs."""
    text = nl_text(["o54 3 v0 n2 v1", "o5 v0 n2"])
    start, end = text.index("V2"), text.index("C0")
    text = text.replace(text[start:end], "").replace(" 1 0 0 0 0", " 0 0 0 0 0")  # the ASL of build-asl refuses these
    values = bodies(read(text, tmp_path))
    assert AslProgram(tmp_path / "some.nl").constraints(POINT) == pytest.approx(values)  # which finds ASL's library
    (tmp_path / "some.nl").write_bytes(binary(text))
    by_asl = AmplNLP(str(tmp_path / "some.nl"))
    by_asl.set_primals(POINT)
    assert by_asl.evaluate_constraints() == pytest.approx(values)
    assert CasadiProgram(tmp_path / "some.nl").constraints(POINT) == pytest.approx(values)


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


@pytest.mark.parametrize("which", [1, 2, 3])
@pytest.mark.parametrize("body", [-1.0, 0.0, 1.0])
@pytest.mark.parametrize("x", [0.0, 0.5, 1.0])
def test_of_a_pair_with_a_number_the_other_side_stays(which: int, body: float, x: float, tmp_path: Path) -> None:
    text = nl_text([f"n{body}"], f"5 {which} 2", pairs=1).replace("0 -1 1", "0 0 1")
    problem = read(text.replace("1 0.5", "1 0"), tmp_path)
    holds = problem.check([0.0, x]).natural == 0.0
    if (which, body) in ((1, -1.0), (2, 1.0)):
        assert not holds
        with pytest.raises(ContradictionError, match="Nothing can satisfy it"):
            problem.model()
        return
    model = problem.model()
    assert len(model.pairs) == 0
    model.x["1"].set_value(x)
    assert (check_point(model).violation == 0.0) == holds


def test_a_row_that_is_complementary_to_a_free_variable_is_an_equation(tmp_path: Path) -> None:
    problem = read(nl_text(["o1 v0 n2"], "5 0 1", pairs=1), tmp_path)
    model = problem.model()
    assert len(model.pairs) == 0
    assert model.rows["0"].equality
    assert problem.check([2.0, 0.0]).violation == 0.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("o0\nv0\nv1", "o48\nv0\nv1"), r"line 17: the operator o48 is not known"),
        (("o0\nv0\nv1", "f0\n1\nv1"), r"line 17: functions in other libraries cannot be read"),
        (("\nO0 0", "\nL0\nO0 0"), "'L' begins no segment"),
        (("\n 0 0 0 0 0\n", "\n 1 0 0 0 0\n"), "1 of its 2 variables are discrete"),
        (("g3 0 1 0", "c3"), "is no .nl file"),
        (("1 9", "5 1 3"), "row 0 cannot be complementary to bounds 1 of variable 2"),
        (("1 9", "5 2 1"), "row 0 is complementary to the upper bound of variable 0, which has none"),
        (("1 9", "7 9"), "'7' is no kind of bounds"),
        (("n0\n", "nx\n"), "cannot be read"),
        (("G0 1\n0 1\n", "G0 1\n0"), "cannot be read"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_refused_with_its_place(change: tuple[str, str], message: str, tmp_path: Path) -> None:
    text = nl_text(["o0 v0 v1"])
    assert change[0] in text
    with pytest.raises(ModelError, match=message):
        read(text.replace(*change, 1), tmp_path)


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="there is no such file"):
        read_file(tmp_path / "some.nl")
    with pytest.raises(ModelError, match=r"neither a .nl nor a .json file"):
        read_file(tmp_path / "some.mod")


def test_a_row_without_variables_holds_or_is_refused(tmp_path: Path) -> None:
    text = nl_text(["n8"]).replace("1 0.5", "1 0")
    assert len(read(text, tmp_path).model().rows) == 0
    with pytest.raises(ContradictionError, match="10, which holds no variable, is not between -inf and 9"):
        read(text.replace("n8", "n10"), tmp_path).model()


def test_values_have_to_fit() -> None:
    with pytest.raises(ModelError, match="1 values for 2 variables"):
        read_file(COLLECTION / "box.nl").check([1.0])


@pytest.mark.parametrize("writer", ["nl_v1", "nl_v2"])
def test_what_pyomo_writes_of_its_own_pairs_is_read(writer: str, tmp_path: Path) -> None:
    """Its transformation ``mpec.nl`` gives each pair variables of its own; it knows no ranges."""
    m = pyo.ConcreteModel()
    m.x, m.y = pyo.Var(initialize=0.5), pyo.Var(bounds=(0, None), initialize=2.0)
    m.pair = mpec.Complementarity(expr=mpec.complements(m.x + m.y - 1 >= 0, m.y >= 0))
    m.other = mpec.Complementarity(expr=mpec.complements(m.x**2 - 3 <= 0, m.y - m.x <= 4))
    m.cost = pyo.Objective(expr=m.x**2 + m.y)
    stated = check_point(m)
    pyo.TransformationFactory("mpec.nl").apply_to(m)
    for block in m.component_data_objects(pyo.Block, active=True):
        for row in block.component_data_objects(pyo.Constraint, descend_into=False):
            if row.equality and row.body.args[0].is_variable_type():  # a variable that is equal to an expression
                row.body.args[0].set_value(0.0, skip_validation=True)
                row.body.args[0].set_value(-pyo.value(row.body) + pyo.value(row.upper), skip_validation=True)
    m.write(str(tmp_path / "m.nl"), format=writer)
    problem = read_file(tmp_path / "m.nl")
    assert len(problem.model().pairs) == 2
    point = problem.check(problem.start)
    assert point.objective == pytest.approx(stated.objective)
    assert point.violation == pytest.approx(0.0, abs=1e-12)
    assert point.natural == pytest.approx(stated.natural)
