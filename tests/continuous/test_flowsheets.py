"""Dynamic flowsheets of IDAES go through unchanged, in whatever order they are fixed and discretised."""

import importlib
from typing import Any

import pyomo.environ as pyo
import pytest
from harness.checked import solution
from harness.dae import sizes

import pyrobocop_pyomo as rcp

pytestmark = [pytest.mark.slow, pytest.mark.casadi, pytest.mark.filterwarnings("ignore")]
OURS, THEIRS = "pyrobocop.collocation", "dae.collocation"
REACTOR_STEADY, HORIZON = 20.316088, 6.0
NAMES = ["reactor", "tanks in series", "controlled tank", "tank with a controller that starts", "pipe reactor"]


def idaes(module: str) -> Any:
    """A module that needs IDAES, loaded late: importing it changes the search path and the logging of a process."""
    pytest.importorskip("idaes", reason="idaes-pse is not installed", exc_type=ImportError)
    return importlib.import_module(module)


def flowsheet_of(name: str) -> Any:
    flowsheets = idaes("catalogue.flowsheets").FLOWSHEETS
    assert list(flowsheets) == NAMES
    return flowsheets[name]


def output(name: str, m: Any, time: float) -> float:
    return pyo.value(flowsheet_of(name).output(m, time))


def discretised(name: str, way: str, before: bool = False, **options: Any) -> Any:
    flowsheet = flowsheet_of(name)
    m = flowsheet.build()
    if before:
        flowsheet.fix(m, changes=False)
    pyo.TransformationFactory(way).apply_to(m, wrt=m.fs.time, nfe=6, ncp=3, **options)
    flowsheet.fix(m)
    return m


def solved_output(name: str, m: Any) -> list[float]:
    result = solution(m, options={"tol": 1e-10})
    assert result.doubts == ()
    return [output(name, m, t) for t in (0, HORIZON / 2, HORIZON)]


@pytest.mark.parametrize("name", NAMES)
def test_answers_are_those_of_dae_collocation_in_every_order(name: str) -> None:
    theirs = discretised(name, THEIRS, scheme="LAGRANGE-RADAU")
    expected, largest = solved_output(name, theirs), sizes(theirs)[0]
    for before in (False, True):
        m = discretised(name, OURS, before)
        variables, equations = sizes(m)
        assert variables == equations
        assert variables <= largest
        assert solved_output(name, m) == pytest.approx(expected, rel=1e-6)
    if name == "reactor":
        assert expected[0] == pytest.approx(REACTOR_STEADY, rel=1e-6)


@pytest.mark.parametrize(("scheme", "before"), [("gauss", True), ("lobatto", False)])
def test_other_schemes_meet_a_fine_mesh(scheme: str, before: bool) -> None:
    """With a feed that does not change, so that Lobatto's first stage sees what the others see.

    The holdup of water is of index 2: Gauss has to know of the volume, to leave one row out at each element boundary.
    """
    found = []
    for options in ({"nfe": 6, "ncp": 3, "scheme": scheme}, {"nfe": 30, "ncp": 4}):
        m = flowsheet_of("reactor").build()
        if before:
            m.fs.r.volume.fix(1.5)
        pyo.TransformationFactory(OURS).apply_to(m, wrt=m.fs.time, **options)
        flowsheet_of("reactor").fix(m, changes=False)
        m.fs.r.control_volume.material_accumulation[0, "Liq", "NaOH"].unfix()
        m.fs.r.outlet.conc_mol_comp[0, "NaOH"].fix(40.0)
        variables, equations = sizes(m)
        assert variables == equations
        found.append(solved_output("reactor", m))
    assert found[0] == pytest.approx(found[1], rel=1e-3)
    assert found[0][0] == pytest.approx(40.0)
    assert found[0][2] == pytest.approx(REACTOR_STEADY, rel=0.02)


def test_initialisation_in_time_by_idaes() -> None:
    """It goes from element to element with a solver that solves square models."""
    m = discretised("reactor", OURS)
    idaes("idaes.core.util.initialization").initialize_by_time_element(
        m.fs, m.fs.time, solver=pyo.SolverFactory("pyrobocop.ipopt")
    )
    guess = output("reactor", m, HORIZON)
    assert solved_output("reactor", m)[2] == pytest.approx(guess, rel=1e-6)


def test_a_control_with_fewer_points_by_its_reference() -> None:
    """Units show variables of their control volumes as references."""
    m = flowsheet_of("reactor").build()
    discretiser = pyo.TransformationFactory(OURS)
    discretiser.apply_to(m, wrt=m.fs.time, nfe=6, ncp=3)
    flowsheet_of("reactor").fix(m)
    m.fs.r.heat_duty.unfix()
    off = [(m.fs.r.outlet.temperature[t] - 300) ** 2 for t in m.fs.time]
    m.cost = pyo.Objective(expr=sum(off) + 1e-14 * sum(heat**2 for heat in m.fs.r.heat_duty.values()))
    discretiser.reduce_collocation_points(m, var=m.fs.r.heat_duty, ncp=1, contset=m.fs.time)
    rcp.solve(m, progress=False).raise_for_status()
    times = [t for t in m.fs.time if 0 < t <= 1]
    assert [m.fs.r.heat_duty[t].value for t in times] == pytest.approx([m.fs.r.heat_duty[1].value] * 3)
    assert abs(m.fs.r.heat_duty[2].value - m.fs.r.heat_duty[1].value) > 1e5


def test_scaling_factors_of_idaes_are_used() -> None:
    """They stand in suffixes of each block, for derivatives that an expression replaces as well."""
    m = discretised("reactor", OURS)
    temperature = m.fs.r.control_volume.properties_out[HORIZON].temperature
    scaling = idaes("idaes.core.util.scaling")
    scaling.set_scaling_factor(temperature, 1 / 250)
    scaling.calculate_scaling_factors(m.fs)
    result = solution(m)
    assert result.scaling is not None
    assert result.scaling.variables[temperature.name] == pytest.approx(250)
    assert output("reactor", m, 0) == pytest.approx(REACTOR_STEADY, rel=1e-6)
