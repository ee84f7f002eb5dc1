"""What a combined plan of a team is worth physically: numbers that no solver reports, and two words for them."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import Any

from pyrobocop_pyomo.presentation import Presented

_LEVELS = ("strict", "practical")


def _measured(label: str, unit: str, whose: str, strict: float, practical: float | None) -> Any:
    """A number of the score: whose trajectory of the object it is about, and the limits of strict and practical.

    What practical asks for, strict asks for as well: a strict plan is practical.
    """
    return field(metadata={"label": label, "unit": unit, "whose": whose, "strict": strict, "practical": practical})


@dataclass(frozen=True)
class PhysicalScore(Presented):
    """How far a combined plan is from physics.

    A combined plan is one trajectory of the object, each robot's own motion, and each robot's own contact forces. The
    object's trajectory *of the plan* is the one that was planned. The *simulated* one starts where that starts and
    moves under the sum of the wrenches that the robots' own forces make; nothing else of the plan is in it.

    Attributes
    ----------
    object_force, object_moment : float
        Largest force and moment that the object would need beside the robots' own wrenches and what resists it, to
        follow the plan: newtons, newton metres.
    robot_force : float
        Largest force that a robot would need beside its driving force and its contact force, newtons.
    cone_excess : float
        Largest force outside the friction cone: negative normal or tangential unknowns included, newtons.
    gap_product : float
        Largest normal force times gap, newton metres.
    friction_product : float
        Largest product of the friction pairs, their slip speed recomputed, newton metres per second.
    separation_product : float
        Largest normal force times separating speed, newton metres per second.
    penetration : float
        Of a robot into the object of the plan, metres.
    goal_distance, goal_angle : float
        Of the simulated object at the end from its goal: metres, degrees.
    gap_at_force : float
        Largest gap to the simulated object where a normal force exceeds 0.1 N, metres.
    simulated_penetration : float
        Of a robot into the simulated object, metres.
    distance : float
        Smallest distance between the centres of two robots, metres; infinite for one robot.
    force_excess : float
        Largest driving force beyond the robots' limits along an axis, newtons.
    speed_excess : float
        Largest speed of a robot beyond its limit along an axis, as planned or as positions have it, metres per second.
    bound_excess : float
        How far a variable of a plan is outside the bounds that the score was given, in its unit.
    end_speed, end_spin : float
        Of the simulated object at the end: metres and degrees per second; 0 where no rest is required.
    robot_end_speed : float
        Of the fastest robot at the end, metres per second; 0 where no rest is required.
    """

    object_force: float = _measured("force missing to the object's path", "N", "plan", 0.05, None)
    object_moment: float = _measured("moment missing to the object's path", "N m", "plan", 0.05, None)
    robot_force: float = _measured("force missing to the robots' paths", "N", "plan", 0.05, None)
    cone_excess: float = _measured("force outside the friction cone", "N", "-", 0.05, 0.05)
    gap_product: float = _measured("force times gap", "N m", "plan", 0.02, 0.02)
    friction_product: float = _measured("friction that does not oppose slip", "N m/s", "plan", 0.02, 0.02)
    separation_product: float = _measured("force times separating speed", "N m/s", "plan", 0.02, 0.02)
    penetration: float = _measured("penetration", "m", "plan", 0.002, None)
    goal_distance: float = _measured("distance from the goal", "m", "simulated", 0.02, 0.05)
    goal_angle: float = _measured("angle from the goal", "deg", "simulated", 2.0, 5.0)
    gap_at_force: float = _measured("gap where a robot pushes", "m", "simulated", 0.01, 0.01)
    simulated_penetration: float = _measured("penetration", "m", "simulated", 0.01, 0.01)
    distance: float = _measured("distance of robots", "m", "-", 0.2, 0.2)
    force_excess: float = _measured("driving force beyond its limit", "N", "-", 0.05, 0.05)
    speed_excess: float = _measured("speed of a robot beyond its limit", "m/s", "-", 0.02, 0.05)
    bound_excess: float = _measured("variable outside its bounds", "-", "plan", 0.002, 0.01)
    end_speed: float = _measured("speed at the end", "m/s", "simulated", 0.02, 0.05)
    end_spin: float = _measured("angular speed at the end", "deg/s", "simulated", 2.0, 5.0)
    robot_end_speed: float = _measured("speed of a robot at the end", "m/s", "-", 0.02, 0.05)

    @property
    def strict(self) -> bool:
        """Whether the plan is practical, residuals are under 0.05 N, penetration under 2 mm; the simulated object ends
        within 2 cm and 2 deg of its goal, at no more than 2 cm and 2 deg per second where rest is required.
        """
        return not self.misses("strict")

    @property
    def practical(self) -> bool:
        """Whether the simulated object ends within 5 cm and 5 deg of its goal, at no more than 5 cm and 5 deg per
        second where rest is required, is pushed where it is touched (gap and penetration under 1 cm), products are
        under 0.02, and robots keep their limits.
        """
        return not self.misses("practical")

    @property
    def product(self) -> float:
        """The largest of the three products."""
        return max(self.gap_product, self.friction_product, self.separation_product)

    def misses(self, level: str) -> list[str]:
        """The numbers that miss the limits of "strict" or "practical"; each as ``'label: value unit (limit)'``."""
        found = []
        for entry in fields(self):
            value, limit, row = getattr(self, entry.name), entry.metadata[level], entry.metadata
            # A number that is not a number keeps no limit.
            if limit is not None and not (value > limit if entry.name == "distance" else value < limit):
                found.append(f"{row['label']} ({row['whose']}): {value:.3g} {row['unit']} (limit {limit:g})")
        return found

    def __str__(self) -> str:
        word = "strict" if self.strict else "practical" if self.practical else "not physically valid"
        lines = [f"physical score: {word}", f"{'':36}{'object':>10}{'value':>12}       strict  practical"]
        for entry in fields(self):
            row, value = entry.metadata, getattr(self, entry.name)
            limits = (row[level] for level in _LEVELS)
            shown = "".join(f"{'-' if limit is None else format(limit, 'g'):>10} " for limit in limits)
            lines.append(f"{row['label']:36}{row['whose']:>10}{value:>12.3g} {row['unit']:6}{shown}".rstrip())
        return "\n".join(lines)
