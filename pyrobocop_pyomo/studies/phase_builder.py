"""`PhaseBuilder`: models that a user's function makes of meshes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.numerics import Mesh
from pyrobocop_pyomo.phases import PhaseBlockData, phases_of


class PhaseBuilder:
    """The user's function of one mesh or of several, and the phases of what it returns.

    Parameters
    ----------
    build : callable
        Takes a mesh, or a mapping of phase names to meshes where the phases are named; returns a model.
    phases : sequence of str, optional
        Names of the phases; the only one of the model by default.
    """

    def __init__(self, build: Callable[[Any], Any], phases: Sequence[str] | None) -> None:
        if isinstance(phases, str):
            raise ModelError(f"phases = {phases!r}; expected a list of names, such as [{phases!r}].")
        self._build = build
        self._named = None if phases is None else list(phases)
        self.names: list[str] = [] if phases is None else list(phases)

    def first_meshes(self, elements: Any, mesh: Any) -> dict[str, Mesh]:
        """Call the user's function once to learn what the phases are and when they happen."""
        if elements is not None and mesh is not None:
            raise ModelError("elements and mesh are given; one of them says what the first mesh is.")
        model = self._call(None if self._named is None else dict.fromkeys(self._named))
        if self._named is None:
            found = [phase.name for phase in phases_of(model)]
            if len(found) != 1:
                raise ModelError(
                    f"build(mesh) returned a model with {len(found)} phases: {', '.join(found) or 'none'}. Pass "
                    "phases=[...], and build will be called with a mapping of their names to meshes."
                )
            self.names = found
        meshes = {name: self.phase(model, name).grid.mesh for name in self.names}
        for given, make in ((elements, _uniform), (mesh, _given)):
            if given is not None:
                wanted = given if isinstance(given, Mapping) else dict.fromkeys(self.names, given)
                unknown = [name for name in wanted if name not in meshes]
                if unknown:
                    raise ModelError(f"a first mesh for '{unknown[0]}'; refined are {', '.join(self.names)}.")
                meshes |= {name: make(meshes[name], each) for name, each in wanted.items()}
        return meshes

    def model(self, meshes: dict[str, Mesh]) -> Any:
        """The user's model on given meshes."""
        model = self._call(meshes[self.names[0]] if self._named is None else dict(meshes))
        for name, mesh in meshes.items():
            made = self.phase(model, name).grid.mesh
            if made != mesh:
                raise ModelError(
                    f"build(mesh) made phase '{name}' with {made.elements} elements; the mesh it was called with has "
                    f"{mesh.elements}. Pass it on: PhaseBlock(..., mesh=mesh)."
                )
        return model

    def phase(self, model: Any, name: str) -> Any:
        """A phase by its name.

        Raises
        ------
        ModelError
            When the model has none of this name.
        """
        phase = model.find_component(name)
        if not isinstance(phase, PhaseBlockData):
            raise ModelError(f"build(...) returned the model '{model.name}', which has no phase '{name}'.")
        return phase

    def _call(self, meshes: Any) -> Any:
        model = self._build(meshes)
        if not hasattr(model, "block_data_objects"):
            raise ModelError(f"build(mesh) returned a {type(model).__name__}; expected a model. Is 'return m' missing?")
        return model


def _uniform(mesh: Mesh, elements: int) -> Mesh:
    return Mesh.uniform(mesh.boundaries[0], mesh.boundaries[-1], elements)


def _given(mesh: Mesh, boundaries: Any) -> Mesh:
    return boundaries if isinstance(boundaries, Mesh) else Mesh.given(boundaries)
