"""Ipopt's problem object, which runs of one program may share as long as its bounds and its options stay."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from pyrobocop_pyomo.programs.nonlinear_program import FloatArray, NonlinearProgram

from .ipopt_callbacks import Interruption, IpoptCallbacks
from .ipopt_library import IpoptLibrary
from .ipopt_outcome import IterationRecord

OnIteration = Callable[[IterationRecord], bool | None]


class KeptProblem:
    """Keeps Ipopt's problem object from one run to the next: making and freeing one takes most of a millisecond.

    It is made anew for another program, other bounds or options of other names. Ipopt never forgets an option, so a
    run that does not set it would be given what an earlier one has set.
    """

    def __init__(self) -> None:
        self._address: int | None = None
        self._library: IpoptLibrary | None = None
        self._callbacks: IpoptCallbacks | None = None
        self._bounds: list[FloatArray] = []
        self._names: frozenset[str] = frozenset()
        self._busy = False

    @property
    def library(self) -> IpoptLibrary | None:
        """What the object was made by: looking for a library in each run takes a tenth of a millisecond."""
        return self._library

    @contextmanager
    def opened(
        self,
        library: IpoptLibrary,
        nlp: NonlinearProgram,
        names: frozenset[str],
        on_iteration: OnIteration | None,
        interruption: Interruption,
    ) -> Iterator[tuple[int, IpoptCallbacks]]:
        """The address of a problem object for one run, and its callbacks.

        Parameters
        ----------
        library : IpoptLibrary
        nlp : NonlinearProgram
        names : frozenset of str
            Of the options that the run sets, and of whatever else stays on the object.
        on_iteration, interruption
            As `IpoptCallbacks` takes them.

        Raises
        ------
        MemoryError
            When Ipopt makes no object.
        """
        if self._busy:  # a run within a callback of a run
            own = KeptProblem()
            try:
                with own.opened(library, nlp, names, on_iteration, interruption) as opened:
                    yield opened
            finally:
                own.close()
            return
        bounds = [np.array(bound, dtype=np.float64) for bound in (nlp.x_lower, nlp.x_upper, nlp.g_lower, nlp.g_upper)]
        callbacks = self._callbacks
        if callbacks is not None and self._fits(library, nlp, names, bounds):
            callbacks.begin(on_iteration, interruption)
        else:
            self.close()
            callbacks = IpoptCallbacks(nlp, on_iteration, interruption)
            self._make(library, nlp, callbacks, bounds)
            self._names = names
        assert self._address is not None
        self._busy = True
        try:
            yield self._address, callbacks
        finally:
            self._busy = False

    def _fits(
        self, library: IpoptLibrary, nlp: NonlinearProgram, names: frozenset[str], bounds: list[FloatArray]
    ) -> bool:
        same = self._library is library and self._callbacks is not None and self._callbacks.nlp is nlp
        return same and names == self._names and all(map(np.array_equal, bounds, self._bounds))

    def _make(
        self, library: IpoptLibrary, nlp: NonlinearProgram, callbacks: IpoptCallbacks, bounds: list[FloatArray]
    ) -> None:
        address = library.functions.CreateIpoptProblem(  # Ipopt copies the bounds
            nlp.n, bounds[0].ctypes.data, bounds[1].ctypes.data, nlp.m, bounds[2].ctypes.data, bounds[3].ctypes.data,
            nlp.jacobian_structure[0].size, nlp.hessian_structure[0].size, 0, *callbacks.evaluators,
        )  # fmt: skip
        if not address:
            callbacks.release()
            raise MemoryError(f"Ipopt could not create a problem with {nlp.n} variables and {nlp.m} rows.")
        library.functions.SetIntermediateCallback(address, callbacks.intermediate)
        self._address, self._library, self._callbacks, self._bounds = address, library, callbacks, bounds

    def close(self) -> None:
        """Free the object; the next run makes another one."""
        address, library, callbacks = self._address, self._library, self._callbacks
        self._address = self._library = self._callbacks = None
        if address is not None and library is not None:
            library.functions.FreeIpoptProblem(address)
        if callbacks is not None:
            callbacks.release()

    def __del__(self) -> None:
        self.close()

    def __reduce__(self) -> tuple[Any, ...]:
        # In a copy or in another process there is no such object yet.
        return KeptProblem, ()
