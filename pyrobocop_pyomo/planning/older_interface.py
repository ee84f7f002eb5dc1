"""The solver in Pyomo's older interface, with the options of `solve` by name."""

from __future__ import annotations

from pyomo.contrib.solver.common.factory import SolverFactory

from pyrobocop_pyomo.ipopt.older_interface import OlderInterface

from .mpcc_solver import CHOICES, Mpcc
from .solve import RETIRED_WORDS


class LegacyMpcc(OlderInterface, Mpcc):
    """`Mpcc` in Pyomo's older interface."""

    own_options = (*CHOICES, *RETIRED_WORDS)


SolverFactory.register(
    name="pyrobocop.mpcc",
    legacy_name="pyrobocop.mpcc",
    doc="Mathematical programs with complementarity constraints: continuation, polish and certificate",
)(Mpcc, LegacyMpcc)
