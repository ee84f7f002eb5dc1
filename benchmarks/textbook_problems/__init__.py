"""Published problems of optimal control: those of ``examples/textbook`` and forty more."""

from __future__ import annotations

import importlib
import sys
from math import log, pi, sqrt
from pathlib import Path
from typing import Any

from . import aloft, chemistry, flight, motions, oscillators, passages, plants, populations, processes, small, switching
from .problem import TextbookProblem

EXAMPLES = Path(__file__).parents[2] / "examples" / "textbook"
if str(EXAMPLES) not in sys.path:
    sys.path.append(str(EXAMPLES))  # the examples are scripts that import one another by name


def example(name: str, source: str, elements: int | None = None, *phases: str, **more: Any) -> TextbookProblem:
    """The problem that an example states."""
    module = importlib.import_module(name)
    return TextbookProblem(name, source, module.PUBLISHED, module.build, elements, phases, **more)


STEEPNESS = (sqrt(33) - 1) ** 0.5 / 24**0.5  # of Fuller's curve of switches, x = -STEEPNESS v |v|
FIRST_SWING, NEXT = 0.1 / (0.5 + STEEPNESS) ** 0.5, (0.5 - STEEPNESS) / (0.5 + STEEPNESS)
LEAST_CHATTERING = (
    2
    / (1 - NEXT**2.5)
    * ((1 + NEXT**2) * 1e-4 * FIRST_SWING - (1 + NEXT) * 0.01 * FIRST_SWING**3 / 3 + FIRST_SWING**5 / 10)
)  # two infinite sequences with rest at zero between them
ROCKET_PHASES = ("boost", "singular", "coast")
THRESHOLD = 0.07 / 0.21  # of the healthy, below which the ill become fewer
SMALLEST_PEAK = (1 - THRESHOLD - THRESHOLD * log((1 - 1e-6) / THRESHOLD)) / (1 + 0.07 * 28)
PROBLEMS = (
    example("alp_rider", "Betts", 100),
    example("ascent", "Benson; GPOPS", 10, "six", "three", "main", "last"),
    example("brachistochrone", "Bryson & Ho; dymos"),
    example("bryson_denham", "Bryson & Ho"),
    example("catalyst_mixing", "COPS 3", 20),
    example("climb", "Bryson et al.; PSOPT", 40),
    example("container_crane", "Sakawa & Shindo", 40, computed=True),
    example("delayed_tank", "Goellmann et al.", 12),
    example("free_flying_robot", "Sakawa; Betts", 60),
    example("goddard_rocket", "COPS 3", 20),
    example("hang_glider", "COPS 3", 50),
    example("hanging_chain", "COPS 3", 20),
    example("isomerisation", "COPS 3"),
    example("linear_tangent_steering", "COPS 3"),
    example("low_thrust_transfer", "Betts", 60),
    example("moon_landing", "Meditch; GPOPS-II", 20),
    example("orbit_raising", "Bryson & Ho", 20),
    example("reentry", "Betts", 50),
    example("robot_arm", "COPS 3", 20),
    example("tuberculosis", "Betts", 20),
    example("two_burn_transfer", "Betts", 10, "coast", "burn", "rise", "arrive"),
    example("zermelo", "Bryson & Ho"),
    TextbookProblem("batch_reactor", "Ray; Biegler", 0.573545, chemistry.batch_reactor, 20),
    TextbookProblem("cart_pole", "Kelly", 57.9447803, small.cart_pole, 20, computed=True),
    TextbookProblem("consecutive_reactions", "Ray", 0.610775, chemistry.consecutive_reactions),
    TextbookProblem("drug_displacement", "Maurer & Wiegand", 221.333, small.drug_displacement, 40),
    TextbookProblem("fastest_stop", "Bryson & Ho", 2.0, small.fastest_stop),
    TextbookProblem("fishing", "Sager; mintOC", 1.34408, small.fishing, 40),
    TextbookProblem("gas_oil", "COPS 3", 5.23659e-3, chemistry.gas_oil),
    TextbookProblem("hypersensitive", "Patterson & Rao", 3.3620563, small.hypersensitive, 100),
    TextbookProblem("jacobson_lele", "Jacobson & Lele; PSOPT", 0.16982, small.jacobson_lele, 20),
    TextbookProblem("largest_range", "Bryson & Ho; PROPT", 1.7127, flight.largest_range),
    TextbookProblem("missile", "Subchan & Zbikowski", 40.9121, flight.missile, 40),
    TextbookProblem("obstacle_avoidance", "PSOPT", 4.57104, flight.obstacle_avoidance, 40),
    TextbookProblem("oil_shale", "Luus", 0.35375, chemistry.oil_shale),
    TextbookProblem("protein_secretion", "Park & Ramirez; Luus", 32.4712, chemistry.protein_secretion, 60),
    TextbookProblem("rayleigh", "Tun & Dillon; PROPT", 29.376, small.rayleigh),
    TextbookProblem("rigid_body", "Betts; PSOPT", 28.6304, flight.rigid_body, 40),
    TextbookProblem("singular_arc", "Aly & Chan", 0.75398386057, small.singular_arc, 20),
    TextbookProblem("stirred_tank", "Luus", 0.13309, chemistry.stirred_tank),
    TextbookProblem("tumour", "Ledzewicz & Schaettler; Betts", 7571.6712, small.tumour, 20),
    TextbookProblem("two_link_robot", "Luus; PSOPT", 2.98364, flight.two_link_robot, 20),
    TextbookProblem("abort_landing", "after Bulirsch et al.", 502.2129, passages.abort_landing, computed=True),
    TextbookProblem(
        "brachistochrone_above_slope", "Betts", 0.323331169, motions.brachistochrone_above_slope, computed=True
    ),
    TextbookProblem(
        "cannonball", "Falck et al.; dymos", 3183.3612, passages.cannonball, None, ("ascent", "descent"), True
    ),
    TextbookProblem(
        "coulomb_friction", "Driessen & Sadegh; PSOPT", 2.1141447, motions.coulomb_friction, 40, computed=True
    ),
    TextbookProblem("delayed_oscillator", "Luus; PSOPT", 2.5257247, oscillators.delayed_oscillator, computed=True),
    TextbookProblem("ethanol", "Chen & Hwang; Banga et al.", 20842.2834, processes.ethanol, computed=True),
    TextbookProblem("farthest_in_a_second", "dymos", 0.25, motions.farthest_in_a_second),
    TextbookProblem("heat_diffusion", "Betts; PSOPT", 4.3703485e-5, processes.heat_diffusion, 20, computed=True),
    TextbookProblem("heated_reentry", "Betts", 30.625474, passages.heated_reentry, 50, computed=True),
    TextbookProblem("immunology", "Joshi; Betts", 29514.4478, oscillators.immunology),
    TextbookProblem("mountain_car", "Moore; dymos", 102.36754, motions.mountain_car, computed=True),
    TextbookProblem(
        "path_tracking", "PROPT; PSOPT", 1.04168615, motions.path_tracking, None, ("along", "across"), True
    ),
    TextbookProblem("pendulum", "Bueskens & Gerdts; Betts", 12.8738889, motions.pendulum, computed=True),
    TextbookProblem("penicillin", "Srinivasan et al.", 1.6826978, processes.penicillin, computed=True),
    TextbookProblem(
        "photochemical_tank", "Jensen; Bojkov et al.", 21.824524, processes.photochemical_tank, computed=True
    ),
    TextbookProblem(
        "rayleigh_with_mixed_limit",
        "Maurer & Augustin",
        44.804445,
        oscillators.rayleigh_with_mixed_limit,
        computed=True,
    ),
    TextbookProblem("short_wire", "dymos", 1.80767971, motions.short_wire, computed=True),
    TextbookProblem(
        "two_burns", "Enright & Conway; dymos", 0.399487833, passages.two_burns, None, ("burn", "coast", "arrive"), True
    ),
    TextbookProblem(
        "van_der_pol_with_limit",
        "Vassiliadis et al.; PROPT",
        2.9538784,
        oscillators.van_der_pol_with_limit,
        computed=True,
    ),
    TextbookProblem("warm_rod", "Betts", 0.468159793, processes.warm_rod),
    TextbookProblem("bifunctional_catalyst", "Luus & Bojkov", 0.0100942, plants.bifunctional_catalyst),
    TextbookProblem("chattering", "Fuller; mintOC", LEAST_CHATTERING, switching.chattering),
    TextbookProblem("dynamic_soaring", "Zhao; GPOPS-II", 0.063728065, aloft.dynamic_soaring, computed=True),
    TextbookProblem("electric_vehicle", "Petit & Sciarretta", 1228.5803, switching.electric_vehicle, computed=True),
    TextbookProblem("epidemic_peak", "Molina & Rapaport", SMALLEST_PEAK, populations.epidemic_peak),
    TextbookProblem("greenhouse", "van Straten; PROPT", -1.8701455, plants.greenhouse, computed=True),
    TextbookProblem("largest_area", "Dido", pi / 2, switching.largest_area),
    TextbookProblem("long_reactor", "Jackson; BOCOP", 0.19181435, plants.long_reactor, computed=True),
    TextbookProblem("marine_stages", "COPS 3", 1.9746530e7, populations.marine_stages, computed=True),
    TextbookProblem("methanol", "COPS 3", 9.0222899e-3, populations.methanol),
    TextbookProblem("oscillator_to_rest", "Pontryagin et al.", 7.9374129, switching.oscillator_to_rest, computed=True),
    TextbookProblem("singular_oscillator", "Vossen", 0.75761793, switching.singular_oscillator, computed=True),
    TextbookProblem("sounding_rocket", "Betts", 18550.872, aloft.sounding_rocket, None, ROCKET_PHASES),
    TextbookProblem("space_station", "Betts; GPOPS-II", 3.5868827, aloft.space_station, computed=True),
    TextbookProblem("tanks_in_a_row", "Dadebo & Luus", 0.024612880, plants.tanks_in_a_row, computed=True),
    TextbookProblem("third_order_limit", "Robbins; BOCOP", 19.431782, switching.third_order_limit, computed=True),
    TextbookProblem("triple_integrator", "Luus; PROPT", 1.2521118, switching.triple_integrator, computed=True),
    TextbookProblem("turn_around", "Dubins", 7 * pi / 3, switching.turn_around),
    TextbookProblem("two_masses", "Liu & Wie", 4.2178666, switching.two_masses, computed=True),
    TextbookProblem("vaccination", "Neilan & Lenhart", 24.133495, populations.vaccination, computed=True),
)
