"""What came of one seed, for both adversaries."""

import enum
from dataclasses import dataclass


@dataclass(frozen=True)
class Trial:
    """A seed, and what came of it.

    Attributes
    ----------
    seed : int
    spoiler : str
    verdict : Verdict
        Of the adversary.
    told : str
        What the package says, or what is wrong with its answer.
    problem : str
        That was spoilt; empty where there is but one.
    clear : bool or None
        Whether a motion keeps its clearance by a dense simulation, where that was asked.
    """

    seed: int
    spoiler: str
    verdict: enum.Enum
    told: str
    problem: str = ""
    clear: bool | None = None

    def __str__(self) -> str:
        spoilt = f"{self.problem}, {self.spoiler}" if self.problem else self.spoiler
        return f"seed {self.seed}: {spoilt}: {self.verdict.value}: {self.told}"
