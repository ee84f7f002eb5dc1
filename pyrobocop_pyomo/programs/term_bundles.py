"""Terms that belong together: those of different shapes that read the same variables, as all rows of one time point do.

Rows of contact or of obstacles repeat the same kinematics many times at each time point. Each shape by itself would
compute the kinematics, and its first and second derivatives, anew; the terms of one time point as the outputs of one
function compute them once.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .expression_codes import Code
from .nonlinear_program import FloatArray
from .term_groups import TermGroup

# A shape with fewer terms than this gets no function of its own: that would take longer to derive than it saves.
FEWEST_TERMS = 12

# Terms of one shape in one bundle. Where there are more, as for the corners of many obstacles, they are evaluated
# as repetitions of each other: what they could share is little beside what each has for itself.
_MOST_REPETITIONS = 4

# Outputs of one bundle: deriving a function takes more than twice as long for twice as many.
_MOST_OUTPUTS = 32

# The part of a bundle's instances that may be left over as odd ones when terms join the others.
_ODD_PART = 0.1


@dataclass(eq=False)
class Output:
    """One term in each instance of a bundle.

    Attributes
    ----------
    code : tuple
        See `expression_codes`.
    variables : int array
        Places of the term's variables among those of the bundle.
    numbers : float array, shape (instances, numbers)
    parameters : int array, shape (instances, numbers)
        The parameters that stand in `numbers`; -1 for a number that stays.
    rows : int array, shape (instances,)
    scales : float array, shape (instances,)
    """

    code: Code
    variables: np.ndarray
    numbers: FloatArray
    parameters: np.ndarray
    rows: np.ndarray
    scales: FloatArray

    def part(self, chosen: np.ndarray) -> Output:
        """The same for some instances."""
        return Output(
            self.code,
            self.variables,
            self.numbers[chosen],
            self.parameters[chosen],
            self.rows[chosen],
            self.scales[chosen],
        )


@dataclass(eq=False)
class Bundle:
    """The same terms over many sets of variables: its *instances*.

    Attributes
    ----------
    columns : int array, shape (instances, variables)
        Different variables in each row.
    outputs : list of Output
    """

    columns: np.ndarray
    outputs: list[Output]

    @classmethod
    def of_group(cls, group: TermGroup) -> Bundle:
        """Each term of a group as an instance."""
        terms = len(group.rows)
        numbers = np.array(group.numbers, dtype=float).reshape(terms, group.numbers_per_term)
        parameters = np.full(numbers.size, -1, dtype=np.intp)
        places, known = np.array(group.parameters, dtype=np.intp).reshape(-1, 2).T
        parameters[places] = known
        output = Output(
            group.code,
            np.arange(group.size),
            numbers,
            parameters.reshape(numbers.shape),
            np.array(group.rows, dtype=np.intp),
            np.array(group.scales, dtype=float),
        )
        return cls(np.array(group.columns, dtype=np.intp).reshape(terms, group.size), [output])

    def part(self, chosen: np.ndarray) -> Bundle:
        """Some of the instances."""
        return Bundle(self.columns[chosen], [output.part(chosen) for output in self.outputs])

    def alone(self, output: Output) -> Bundle:
        """One of the outputs, with its own variables."""
        own = np.arange(output.variables.size)
        return Bundle(self.columns[:, output.variables], [replace(output, variables=own)])

    def joined(self, other: Bundle, places: np.ndarray) -> Bundle:
        """These instances with the outputs of others, one for each.

        Parameters
        ----------
        other : Bundle
            With as many instances.
        places : int array
            Places of its variables among those of this bundle, -1 for one that is not among them.
        """
        new = np.flatnonzero(places < 0)
        places = places.copy()
        places[new] = self.columns.shape[1] + np.arange(new.size)
        moved = [
            Output(part.code, places[part.variables], part.numbers, part.parameters, part.rows, part.scales)
            for part in other.outputs
        ]
        return Bundle(np.hstack([self.columns, other.columns[:, new]]), [*self.outputs, *moved])


def bundles_of(groups: Sequence[TermGroup], variables: int) -> list[Bundle]:
    """Terms put together, those with the most variables first.

    A term joins the instance that reads at least half of its variables, if the terms of the same shape do so in
    nearly all instances of that bundle. What does not join anywhere stays a bundle of its own.

    Parameters
    ----------
    groups : sequence of TermGroup
    variables : int
        Count of all variables.
    """
    assembly = _Assembly(variables)
    for group in sorted(groups, key=lambda group: -group.size):
        assembly.put(Bundle.of_group(group))
    return _with_few_apart([*assembly.bundles, *assembly.few])


def _with_few_apart(bundles: list[Bundle]) -> list[Bundle]:
    """Bundles of few instances taken apart into their terms, of which those of one shape are one bundle again.

    What is left with few instances becomes one function, which takes long to derive where it has many outputs.
    """
    of_shape: dict[Code, list[Bundle]] = defaultdict(list)
    for bundle in bundles:
        if bundle.columns.shape[0] < FEWEST_TERMS:
            for output in bundle.outputs:
                of_shape[output.code].append(bundle.alone(output))
    return [bundle for bundle in bundles if bundle.columns.shape[0] >= FEWEST_TERMS] + [
        _stacked(several) for several in of_shape.values()
    ]


def _stacked(bundles: Sequence[Bundle]) -> Bundle:
    """Bundles of one output of one shape as one."""
    outputs = [bundle.outputs[0] for bundle in bundles]
    numbers, parameters, rows, scales = (
        np.concatenate([getattr(output, name) for output in outputs])
        for name in ("numbers", "parameters", "rows", "scales")
    )
    one = Output(outputs[0].code, outputs[0].variables, numbers, parameters, rows, scales)
    return Bundle(np.concatenate([bundle.columns for bundle in bundles]), [one])


class _Assembly:
    """Bundles under construction, and for each variable the instance that first read it."""

    def __init__(self, variables: int) -> None:
        self.bundles: list[Bundle] = []
        self.few: list[Bundle] = []  # nothing joins these: they own no variables
        self._owner = np.full(variables, -1, dtype=np.intp)
        self._bundle_of = np.empty(0, dtype=np.intp)
        self._place_of = np.empty(0, dtype=np.intp)
        self._identities: list[np.ndarray] = []

    def put(self, terms: Bundle) -> None:
        """Let terms of one shape join what there is; the others become instances of new bundles."""
        rest = self._join(terms)
        if rest.columns.shape[0] >= FEWEST_TERMS and rest.columns.shape[1]:
            leading = _leading(rest.columns)
            if FEWEST_TERMS <= np.count_nonzero(leading) < leading.size:
                self._add(rest.part(leading))
                rest = self._join(rest.part(~leading))
        if rest.columns.shape[0] >= FEWEST_TERMS:
            self._add(rest)
        elif rest.columns.shape[0]:
            self.few.append(rest)

    def _add(self, bundle: Bundle) -> None:
        instances = bundle.columns.shape[0]
        identities = self._place_of.size + np.arange(instances)
        self._bundle_of = np.concatenate([self._bundle_of, np.full(instances, len(self.bundles))])
        self._place_of = np.concatenate([self._place_of, np.arange(instances)])
        self.bundles.append(bundle)
        self._identities.append(identities)
        self._own(bundle.columns, identities)

    def _own(self, columns: np.ndarray, identities: np.ndarray) -> None:
        """Variables that no instance has read belong to the first of these that reads them."""
        backwards = columns.ravel()[::-1]  # of values for the same place NumPy keeps the last
        owners = np.repeat(identities, columns.shape[1])[::-1]
        unknown = self._owner[backwards] < 0
        self._owner[backwards[unknown]] = owners[unknown]

    def _join(self, terms: Bundle) -> Bundle:
        """Let as many terms join as can; returns the others."""
        while terms.columns.shape[0] >= FEWEST_TERMS and terms.columns.shape[1]:
            found = self._largest_class(terms.columns)
            if found is None:
                break
            bundle, chosen, places, pattern = found
            self._attach(bundle, places, terms.part(chosen), pattern)
            others = np.ones(terms.columns.shape[0], dtype=bool)
            others[chosen] = False
            terms = terms.part(others)
        return terms

    def _largest_class(self, columns: np.ndarray) -> tuple[int, np.ndarray, np.ndarray, np.ndarray] | None:
        """The most terms that can join one bundle in the same way: bundle, terms, instances, places of variables."""
        # Where time points share variables, the newest variable says which of them a term belongs to.
        newest = self._owner[columns].max(axis=1)
        candidates: list[tuple[int, int, np.ndarray, np.ndarray, np.ndarray]] = []
        for bundle in np.unique(self._bundle_of[newest[newest >= 0]]):
            instances = self.bundles[bundle].columns
            terms = np.flatnonzero((newest >= 0) & (self._bundle_of[newest] == bundle))
            if min(terms.size, instances.shape[0]) < FEWEST_TERMS:
                continue
            places = self._place_of[newest[terms]]
            patterns = np.full((terms.size, columns.shape[1]), -1, dtype=np.intp)
            for k in range(instances.shape[1]):
                patterns[columns[terms] == instances[places, k][:, None]] = k
            kinds = _row_numbers(patterns + 1, instances.shape[1] + 1)
            repetitions = _repetitions(kinds, places)
            ways = _row_numbers(np.column_stack([kinds, repetitions]), terms.size)
            for way in np.flatnonzero(np.bincount(ways) >= FEWEST_TERMS):
                chosen = np.flatnonzero(ways == way)
                pattern = patterns[chosen[0]]
                if repetitions[chosen[0]] < _MOST_REPETITIONS and self._may_join(bundle, chosen.size, pattern):
                    candidates.append((chosen.size, int(bundle), terms[chosen], places[chosen], pattern))
        if not candidates:
            return None
        return max(candidates, key=lambda candidate: candidate[0])[1:]

    def _may_join(self, bundle: int, terms: int, pattern: np.ndarray) -> bool:
        instances = self.bundles[bundle].columns.shape[0]
        odd = instances - terms
        if terms < FEWEST_TERMS or FEWEST_TERMS > odd > _ODD_PART * instances:
            return False
        if len(self.bundles[bundle].outputs) >= _MOST_OUTPUTS:
            return False
        return bool(2 * np.count_nonzero(pattern >= 0) >= pattern.size)

    def _attach(self, bundle: int, places: np.ndarray, terms: Bundle, pattern: np.ndarray) -> None:
        """Join terms with the instances at some places of a bundle; the bundle's other instances become another."""
        whole, identities = self.bundles[bundle], self._identities[bundle]
        others = np.ones(whole.columns.shape[0], dtype=bool)
        others[places] = False
        if others.any():
            rest = identities[others]
            self._bundle_of[rest], self._place_of[rest] = len(self.bundles), np.arange(rest.size)
            self.bundles.append(whole.part(others))
            self._identities.append(rest)
        order = np.argsort(places)
        places = places[order]
        identities = identities[places]
        self.bundles[bundle] = joined = whole.part(places).joined(terms.part(order), pattern)
        self._place_of[identities] = np.arange(identities.size)
        self._identities[bundle] = identities
        self._own(joined.columns, identities)


def _leading(columns: np.ndarray) -> np.ndarray:
    """Which terms read at least as many variables that no term before them read as others."""
    _, first = np.unique(columns, return_index=True)
    new = np.bincount(first // columns.shape[1], minlength=columns.shape[0])
    return np.asarray(2 * new >= columns.shape[1])


def _row_numbers(rows: np.ndarray, radix: int) -> np.ndarray:
    """A number from 0 on for each row, the same for equal rows; entries are below the radix."""
    numbers, limit = np.zeros(rows.shape[0], dtype=np.int64), 1
    for column in rows.T:
        if limit * radix >= 1 << 63:
            numbers = np.unique(numbers, return_inverse=True)[1].ravel()
            limit = rows.shape[0]
        numbers, limit = numbers * radix + column, limit * radix
    return np.asarray(np.unique(numbers, return_inverse=True)[1].ravel())


def _repetitions(kinds: np.ndarray, places: np.ndarray) -> np.ndarray:
    """How many entries before each have the same kind and place."""
    order = np.lexsort((places, kinds))
    same = (np.diff(kinds[order]) == 0) & (np.diff(places[order]) == 0)
    starts = np.flatnonzero(np.concatenate([[True], ~same]))
    lengths = np.diff(np.append(starts, order.size))
    counts = np.empty(order.size, dtype=np.intp)
    counts[order] = np.arange(order.size) - np.repeat(starts, lengths)
    return counts
