"""`Checkpoint`: all that a team needs to go on later, in a file of arrays and JSON. Nothing in it is unpickled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pyrobocop_pyomo.errors import TeamError, TrajectoryError
from pyrobocop_pyomo.trajectories.exchange import read_archive, write_archive


@dataclass(frozen=True)
class Checkpoint:
    """A team between two rounds.

    Attributes
    ----------
    round : int
        How many rounds were done.
    fingerprint : str
        Of what the team was made of: `fingerprint` of its specs.
    states : mapping of agent's name to (mapping of name to array)
        As `Engine.states` gives them.
    coordinator : mapping of name to array
        What the coordinator has to know.
    """

    round: int
    fingerprint: str
    states: Mapping[str, Mapping[str, np.ndarray]]
    coordinator: Mapping[str, np.ndarray] = field(default_factory=dict)

    def save(self, path: str | Path) -> Path:
        """Write it, at once or not at all: whoever reads meanwhile finds the file before or this one.

        Parameters
        ----------
        path : str or Path
            The suffix ``.npz`` is added where it is missing.

        Returns
        -------
        Path
            The file written.

        Raises
        ------
        TeamError
            When something in it is no array of numbers or texts.
        """
        groups = {f"agent{i}": dict(state) for i, state in enumerate(self.states.values())}
        groups["coordinator"] = dict(self.coordinator)
        for where, group in zip([*self.states, "coordinator"], groups.values(), strict=True):
            for name, values in group.items():
                if np.asarray(values).dtype.hasobject:
                    raise TeamError(f"{path}: '{name}' of '{where}' is no array of numbers; it cannot be saved.")
        facts = {"round": int(self.round), "fingerprint": self.fingerprint, "agents": list(self.states)}
        return write_archive(path, facts, groups)

    @classmethod
    def load(cls, path: str | Path, fingerprint: str | None = None) -> Checkpoint:
        """Read it.

        Parameters
        ----------
        path : str or Path
        fingerprint : str, optional
            Of the team that is to go on.

        Returns
        -------
        Checkpoint

        Raises
        ------
        TeamError
            When the file is not there, is damaged or holds something else, or belongs to another team.
        """
        try:
            facts, groups = read_archive(path)
            states = {name: groups[f"agent{i}"] for i, name in enumerate(facts["agents"])}
            found = cls(int(facts["round"]), str(facts["fingerprint"]), states, groups["coordinator"])
        except (TrajectoryError, KeyError, TypeError, ValueError) as error:
            raise TeamError(f"{path}: no checkpoint can be read from it ({error.__cause__ or error!r}).") from error
        if fingerprint is not None and found.fingerprint != fingerprint:
            raise TeamError(
                f"{path}: written by another team (fingerprint {found.fingerprint[:12]}, this one has "
                f"{fingerprint[:12]}; its agents are {', '.join(found.states)}). Builders, data, shared quantities "
                "and options have to be the same. To start anew, take another file or delete this one."
            )
        return found
