"""`EstimationProblem`: labelled experiments as one model with a sum of squares, whose data may be exchanged.

`OutputSensitivities`: how measured outputs move with the unknowns, on the branch that the model is on.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentMap
from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.block import BlockData
from pyomo.core.base.constraint import Constraint, ConstraintList
from pyomo.core.base.objective import Objective
from pyomo.core.base.param import Param
from pyomo.core.base.PyomoModel import ConcreteModel
from pyomo.core.base.set import Reals
from pyomo.core.base.suffix import Suffix
from pyomo.core.base.var import Var
from pyomo.core.expr.numvalue import value

from pyrobocop_pyomo.complementarity import SidePart, active_sources, canonical_form, side_values, sides_at_zero
from pyrobocop_pyomo.errors import EstimationError, EvaluationError
from pyrobocop_pyomo.modeling.shared_nodes import variables_in
from pyrobocop_pyomo.mpcc.problem import Linearisation
from pyrobocop_pyomo.numerics import Array
from pyrobocop_pyomo.numerics.rounding import MET
from pyrobocop_pyomo.optional_imports import pandas, parmest_models, scipy
from pyrobocop_pyomo.programs.compiled_model import CompiledModel

# --------------------------------------------------------------------------------------------- sensitivities of outputs


LARGEST_SOLUTION = 1e13  # of a system that is not singular, relative to its right side


class OutputSensitivities:
    """Linearises a model again and again, after one compilation.

    Parameters
    ----------
    model : Block
        Not relaxed.
    outputs : sequence of Pyomo expressions
    unknowns : sequence of VarData
        Free ones.
    """

    def __init__(self, model: Any, outputs: Sequence[Any], unknowns: Sequence[Any]) -> None:
        self._model, self._unknowns = model, list(unknowns)
        self._scratch = ConcreteModel()
        self._scratch.rows = ConstraintList()
        self._equations: list[Any] = []
        self._forms = [canonical_form(source) for source in active_sources(model)]
        relations = [constraint.expr for constraint in model.component_data_objects(Constraint, active=True)]
        for relation in (*relations, *(relation for form in self._forms for relation in form.rows)):
            if any(True for _ in variables_in(relation, include_fixed=True)):
                row = self._scratch.rows.add(relation)
                self._equations += [row] if row.equality else []
        pairs = [pair for form in self._forms for pair in form.pairs]
        self._sides = {id(side): self._added(side) for pair in pairs for side in (pair.a, pair.b)}
        self._outputs = [self._added(output) for output in outputs]
        self._compiled: CompiledModel | None = None

    def _added(self, expression: Any) -> Any:
        """A row with the derivatives of an expression; None where that has no variables."""
        if not hasattr(expression, "is_potentially_variable") or not expression.is_potentially_variable():
            return None
        # No equation: one of fixed variables alone would contradict itself.
        return self._scratch.rows.add(expression <= 1e30)

    def at_current_values(self) -> tuple[Array, list[str]]:
        """Differentiate at the values that stand on the model.

        Returns
        -------
        matrix : array, shape (outputs, unknowns)
            With everything else moving as the equations, on this branch, ask for.
        biactive : list of str
            Pairs where the branch was chosen among several: one-sided derivatives there.

        Raises
        ------
        EvaluationError
            When outputs do not follow from the unknowns there: equations are too few, too many or dependent.
        """
        if self._compiled is None:
            self._compiled = CompiledModel(self._scratch, "vectorised")
        else:
            self._compiled.update()
        compiled = self._compiled
        jacobian = Linearisation.at(compiled.nlp, compiled.current_point()).jacobian
        zero = [self._sides[id(side)] for form in self._forms for _, side, _ in sides_at_zero(form)]
        stated = (pair for form in self._forms for pair in form.pairs if pair.a_part is SidePart.WHOLE)
        biactive = [pair.name for pair in stated if max(side_values(pair)) <= MET]
        row_of = compiled.row_of
        chosen = [row_of[row] for row in (*self._equations, *zero) if row is not None and row in row_of]
        place = {id(variable): i for i, variable in enumerate(compiled.variables)}
        columns = np.array([place.get(id(variable), -1) for variable in self._unknowns], dtype=int)
        in_use = np.flatnonzero(columns >= 0)
        others = np.setdiff1d(np.arange(compiled.nlp.n), columns[in_use])
        rows = jacobian[chosen]
        moved = _moved(rows[:, others], rows[:, columns[in_use]].toarray())
        has_row = np.array([row is not None and row in row_of for row in self._outputs], dtype=bool)
        of_outputs = jacobian[[row_of[row] for row in self._outputs if row is not None and row in row_of]]
        matrix = np.zeros((len(self._outputs), len(self._unknowns)))
        matrix[np.ix_(has_row, in_use)] = of_outputs[:, columns[in_use]].toarray() + of_outputs[:, others] @ moved
        return matrix, biactive


def _moved(others: Any, unknowns: Array) -> Array:
    """How the other variables move with the unknowns so that the rows, of which these are the columns, stay met."""
    rows, count = others.shape
    solved = np.full((count, unknowns.shape[1]), np.nan)
    if rows == count > 0:
        with contextlib.suppress(RuntimeError):  # SciPy's way to say: exactly singular
            factor = scipy.sparse.linalg.splu(scipy.sparse.csc_array(others))
            solved = factor.solve(unknowns)
            solved += factor.solve(unknowns - others @ solved)  # unstable motions cost digits: one refinement
    # A matrix that is singular but for rounding shows in the size of the solution.
    largest = LARGEST_SOLUTION * max(1.0, float(np.abs(unknowns).max(initial=0.0)))
    if not (np.abs(solved) <= largest).all():
        raise EvaluationError(
            f"the {rows} equations that hold there do not say how {count} other variables move with what is estimated. "
            "Fix controls at what was applied, estimate fewer parameters, and remove equations that repeat others or "
            "tie parameters to numbers."
        )
    return -solved


# ----------------------------------------------------------------------------------------------------------- estimation


class EstimationProblem:
    """Experiments whose unknowns are found together.

    Parameters
    ----------
    experiments : labelled model, object with ``get_labeled_model()``, or a list of them
        As for `estimate`. The models are copied, and their objectives do not count.

    Attributes
    ----------
    model : ConcreteModel
        All experiments, with one objective: a sum of weighted squares. Measurements and weights are mutable
        Params on it; so it can be given to `sweep`.
    experiments : list of Block
        The copies, which are blocks of the model.
    unknowns : dict of str to list of VarData
        What is estimated, by its name in the experiments; variables of several experiments are held equal.
    data : DataFrame
        A row for each measurement: experiment, output, time (NaN where it has none), measured (NaN where it is
        missing), and deviation, its standard deviation (NaN where it is not known).
    weights : array, shape (measurements,)
        Of the squared residuals: over the variance where it is known; zero where nothing was measured.
    ranges : Series
        Of the data of each output.

    Raises
    ------
    EstimationError
        When there are no labels, or they make no sense.
    """

    def __init__(self, experiments: Any) -> None:
        given = experiments if isinstance(experiments, (list, tuple)) else [experiments]
        if not given:
            raise EstimationError("there are no experiments.")
        with PauseGC():
            self.experiments = [_labelled_copy(each) for each in given]
            self.unknowns: dict[str, list[Any]] = {}
            for model in self.experiments:
                for variable in _unknowns_of(model):
                    self.unknowns.setdefault(variable.name, []).append(variable)
            measured = [row for number, each in enumerate(self.experiments, start=1) for row in _rows(each, number)]
            self._predicted = [component for component, *_ in measured]
            columns = ["experiment", "output", "time", "measured", "deviation"]
            self.data = pandas.DataFrame([row for _, *row in measured], columns=columns)
            self.model = self._stated()
        self.put(self.data["measured"])
        self.sensitivities = OutputSensitivities(self.model, self._predicted, self.variables)

    def _stated(self) -> ConcreteModel:
        m = ConcreteModel(name="estimation")
        for number, experiment in enumerate(self.experiments, start=1):
            m.add_component(f"experiment_{number}", experiment)
        m.shared = ConstraintList()
        for first, *others in self.unknowns.values():
            for other in others:
                other.set_value(first.value, skip_validation=True)
                m.shared.add(other == first)
        numbers = range(len(self._predicted))
        m.measured = Param(numbers, initialize=0.0, mutable=True, within=Reals)
        m.weight = Param(numbers, initialize=0.0, mutable=True, within=Reals)
        squares = (m.weight[i] * (each - m.measured[i]) ** 2 for i, each in enumerate(self._predicted))
        m.squares = Objective(expr=sum(squares))
        return m

    def put(self, measured: Any, error: Any = None) -> None:
        """Exchange the measurements; times stay as they are.

        Parameters
        ----------
        measured : array, shape (measurements,)
            In the order of `data`; NaN where one is missing.
        error : number or array, shape (measurements,), optional
            Standard deviations, where they are other ones as well.

        Raises
        ------
        EstimationError
            When there are more or fewer numbers than before, or none.
        """
        if len(measured) != len(self.data):
            raise EstimationError(f"{len(measured)} measurements were given; the problem has {len(self.data)}.")
        self.data["measured"] = np.asarray(measured, dtype=float)
        if error is not None:
            self.data["deviation"] = error
        present, known = self.data["measured"].notna().to_numpy(), self.data["deviation"].notna()
        if not present.any():
            raise EstimationError("there is no number among the measurements.")
        if known.any() and not known.all():
            raise EstimationError(
                f"the error of '{self.data['output'][known.idxmin()]}' is not given, but those of others are. Give all "
                "standard deviations, or none."
            )
        weights = (1.0 / self.data["deviation"] ** 2).fillna(1.0).to_numpy()
        self.weights = np.where(present, weights, 0.0)
        by_output = self.data.groupby("output", sort=False)["measured"]
        self.ranges = (by_output.max() - by_output.min()).replace(0.0, np.nan)
        self.ranges = self.ranges.fillna(by_output.max().abs().clip(lower=1.0)).fillna(1.0)
        # A common factor makes the objective the number of data where nothing is explained: so a solver's tolerances
        # mean the same whatever the units, and however small the errors.
        spread = self.data["output"].map(self.ranges).to_numpy()
        factor = float(present.sum()) / max(float((self.weights * (spread / 4) ** 2).sum()), 1e-300)
        self.model.measured.store_values(self.data["measured"].fillna(0.0).to_dict())
        self.model.weight.store_values(dict(enumerate((self.weights * factor).tolist())))

    @property
    def variables(self) -> list[Any]:
        """One variable for each unknown."""
        return [first for first, *_ in self.unknowns.values()]

    def predictions(self) -> Array:
        """What the model says of each measurement now, whether it is missing or not; shape (measurements,)."""
        return np.array([float(value(each)) for each in self._predicted])


def _labelled_copy(given: Any) -> Any:
    """A copy of a labelled model, or of the one that an object makes, with unknown Params as variables."""
    model = given.get_labeled_model() if hasattr(given, "get_labeled_model") else given
    if not isinstance(model, BlockData) or not model.is_constructed():
        raise EstimationError(
            f"expected a labelled model, or an experiment that makes one; found {type(model).__name__}."
        )
    for label in ("experiment_outputs", "unknown_parameters"):
        suffix = model.component(label)
        if suffix is None or suffix.ctype is not Suffix or not len(suffix):
            raise EstimationError(
                f"the model '{model.name}' has no suffix '{label}' with entries. rcp.label_measurements makes it for "
                "a phase."
            )
    params = [component.name for component in model.unknown_parameters if component.ctype is not Var]
    copy = parmest_models.convert_params_to_vars(model, params, fix_vars=False) if params else model.clone()
    for objective in copy.component_data_objects(Objective, active=True):
        objective.deactivate()
    return copy


def _unknowns_of(model: Any) -> list[Any]:
    """The variables that are labelled as unknown, freed."""
    unknowns: list[Any] = []
    for component in model.unknown_parameters:
        unknowns += component.values() if component.is_indexed() else [component]
    for variable in unknowns:
        if variable.value is None:
            raise EstimationError(f"'{variable.name}': has no value to start from. Give it an initial guess.")
        variable.unfix()
    return unknowns


def _rows(model: Any, number: int) -> list[tuple[Any, ...]]:
    """Each labelled output with its row of the data."""
    errors, rows = model.component("measurement_error") or ComponentMap(), []
    for component, measured in model.experiment_outputs.items():
        index, output, time = component.index(), component.name, np.nan
        if isinstance(index, (int, float)) and not isinstance(index, bool):  # one number is taken for the time
            output, time = component.parent_component().name, float(index)
        deviation = errors.get(component)
        if deviation is not None and not float(deviation) > 0.0:
            raise EstimationError(f"the measurement_error of '{component.name}' is {deviation!r}, not positive.")
        numbers = (np.nan if each is None else float(value(each)) for each in (measured, deviation))
        rows.append((component, number, output, time, *numbers))
    return rows
