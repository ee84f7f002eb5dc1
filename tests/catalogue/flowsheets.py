"""Dynamic flowsheets of IDAES whose property packages need nothing compiled, as its users write them.

Each entry builds a flowsheet, and fixes its inputs and initial conditions on the points that its time has then. The
feed may change after the start, so that there is something to follow.
"""

import logging
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import pyomo.environ as pyo
from idaes.core import FlowsheetBlock
from idaes.models.control.controller import ControllerType, PIDController
from idaes.models.properties.examples.saponification_reactions import SaponificationReactionParameterBlock
from idaes.models.properties.examples.saponification_thermo import SaponificationParameterBlock
from idaes.models.unit_models import CSTR, PFR
from pyomo.network import Arc

logging.getLogger("idaes").setLevel(logging.ERROR)

HORIZON = 6.0
SPECIES = {"H2O": 55388.0, "NaOH": 100.0, "EthylAcetate": 100.0, "SodiumAcetate": 1e-8, "Ethanol": 1e-8}


class Flowsheet(NamedTuple):
    """A model, what is fixed in it, and a variable to look at."""

    build: Callable[[], Any]
    fix: Callable[..., None]
    output: Callable[[Any, float], Any]


def flowsheet(name: str) -> Any:
    m = pyo.ConcreteModel(name)
    m.fs = FlowsheetBlock(dynamic=True, time_set=[0, HORIZON], time_units=pyo.units.s)
    m.fs.properties = SaponificationParameterBlock()
    m.fs.reactions = SaponificationReactionParameterBlock(property_package=m.fs.properties)
    return m


def tank(m: Any) -> Any:
    return CSTR(
        property_package=m.fs.properties,
        reaction_package=m.fs.reactions,
        dynamic=True,
        has_holdup=True,
        has_heat_of_reaction=True,
        has_heat_transfer=True,
    )


def fix_feed(m: Any, inlet: Any, changes: bool, flow: float = 1.0) -> None:
    for t in m.fs.time:
        inlet.flow_vol[t].fix(flow)
        inlet.temperature[t].fix(303.15)
        inlet.pressure[t].fix(101325.0)
        for species, concentration in SPECIES.items():
            factor = 0.5 if changes and species == "NaOH" and t > 0 else 1.0
            inlet.conc_mol_comp[t, species].fix(factor * concentration)


def reactor() -> Any:
    m = flowsheet("reactor")
    m.fs.r = tank(m)
    return m


def fix_reactor(m: Any, changes: bool = True) -> None:
    fix_feed(m, m.fs.r.inlet, changes)
    m.fs.r.volume.fix(1.5)
    m.fs.r.heat_duty.fix(0)
    m.fs.fix_initial_conditions("steady-state")


def tanks_in_series() -> Any:
    m = flowsheet("tanks in series")
    m.fs.first, m.fs.second = tank(m), tank(m)
    m.fs.stream = Arc(source=m.fs.first.outlet, destination=m.fs.second.inlet)
    pyo.TransformationFactory("network.expand_arcs").apply_to(m.fs)
    return m


def fix_tanks(m: Any, changes: bool = True) -> None:
    fix_feed(m, m.fs.first.inlet, changes)
    for unit, volume in ((m.fs.first, 1.5), (m.fs.second, 0.8)):
        unit.volume.fix(volume)
        unit.heat_duty.fix(0)
    m.fs.fix_initial_conditions("steady-state")


def controlled_tank(calculated: bool) -> Any:
    """The level drives the flow out; a PI controller heats to keep a concentration."""
    m = flowsheet("controlled tank")
    m.fs.r = tank(m)
    m.fs.r.height = pyo.Var(m.fs.time, initialize=1.0, units=pyo.units.m)
    area = 1.5 * pyo.units.m**2
    valve = 1.0 * pyo.units.m**2.5 / pyo.units.s
    m.fs.r.shape = pyo.Constraint(m.fs.time, rule=lambda b, t: b.volume[t] == area * b.height[t])
    m.fs.r.outflow = pyo.Constraint(
        m.fs.time,
        rule=lambda b, t: b.control_volume.properties_out[t].flow_vol == valve * b.height[t] ** 0.5,
    )
    m.fs.temperature = pyo.Reference(m.fs.r.control_volume.properties_out[:].temperature)
    m.fs.heat = pyo.Reference(m.fs.r.control_volume.heat[:])
    m.fs.control = PIDController(
        process_var=m.fs.temperature,
        manipulated_var=m.fs.heat,
        controller_type=ControllerType.PI,
        calculate_initial_integral=calculated,
    )
    return m


def fix_controlled_tank(m: Any, changes: bool = True) -> None:
    fix_feed(m, m.fs.r.inlet, changes, 1.2)
    m.fs.control.setpoint.fix(310.0)
    m.fs.control.gain_p.fix(1e6)
    m.fs.control.gain_i.fix(1e6)
    m.fs.control.mv_ref.fix(0)
    if m.fs.control.config.calculate_initial_integral:
        m.fs.heat[m.fs.time.first()].fix(1e7)
    else:
        m.fs.control.mv_integral_component[m.fs.time.first()].fix(0)
    m.fs.fix_initial_conditions("steady-state")
    m.fs.r.control_volume.energy_accumulation[m.fs.time.first(), :].unfix()
    m.fs.r.control_volume.properties_out[m.fs.time.first()].temperature.fix(305.0)


def pipe_reactor() -> Any:
    m = flowsheet("pipe reactor")
    m.fs.r = PFR(
        property_package=m.fs.properties,
        reaction_package=m.fs.reactions,
        dynamic=True,
        has_holdup=True,
        has_heat_of_reaction=True,
        has_heat_transfer=True,
        transformation_method="dae.finite_difference",
        transformation_scheme="BACKWARD",
        finite_elements=4,
    )
    return m


def fix_pipe_reactor(m: Any, changes: bool = True) -> None:
    fix_feed(m, m.fs.r.inlet, changes)
    m.fs.r.length.fix(0.5)
    m.fs.r.volume.fix(0.5)
    m.fs.r.control_volume.heat.fix(0)
    m.fs.fix_initial_conditions("steady-state")


FLOWSHEETS = {
    "reactor": Flowsheet(reactor, fix_reactor, lambda m, t: m.fs.r.outlet.conc_mol_comp[t, "NaOH"]),
    "tanks in series": Flowsheet(tanks_in_series, fix_tanks, lambda m, t: m.fs.second.outlet.conc_mol_comp[t, "NaOH"]),
    "controlled tank": Flowsheet(
        partial(controlled_tank, False), fix_controlled_tank, lambda m, t: m.fs.temperature[t]
    ),
    "tank with a controller that starts": Flowsheet(
        partial(controlled_tank, True), fix_controlled_tank, lambda m, t: m.fs.temperature[t]
    ),
    "pipe reactor": Flowsheet(pipe_reactor, fix_pipe_reactor, lambda m, t: m.fs.r.outlet.conc_mol_comp[t, "NaOH"]),
}
