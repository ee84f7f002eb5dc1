"""Starts for plans among obstacles that know one kind of model: paths of cars, or among configurations of an arm.

They stand in folders of `contrib`. A folder with a module `start_provider` is found by its name, so that nothing here
imports one, and its starts are gone where the folder is.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pkgutil import iter_modules
from typing import Any, NamedTuple, Protocol

from pyrobocop_pyomo.modeling.deadline import Deadline

CONTRIB = "pyrobocop_pyomo.contrib"
# Clearances that a path keeps: a second path, farther from everything, is another start.
PATH_CLEARANCES = (1.0, 2.0)
_REGISTERED: list[StartProvider] = []


class Fit(NamedTuple):
    """How starts of one kind stand to those that a plan has anyway.

    Attributes
    ----------
    comes_first : bool
        The initial guess is so far off that solving from it would be in vain.
    may_be_led_around : bool
        Whether the guess is a start too when a path on a grid leads it around obstacles.
    obeys_equations : bool
        The starts are motions that the model can make; providers that only know its shapes are not asked then.
    """

    comes_first: bool = False
    may_be_led_around: bool = True
    obeys_equations: bool = False


class StartProvider(Protocol):
    """Knows starts for models of one kind."""

    def fits(self, model: Any) -> Fit | None:
        """How its starts fit a model, whose values are the user's initial guess; None for models of other kinds."""

    def propose(self, model: Any, deadline: Deadline) -> Iterator[str]:
        """Put one start after another on the model, and say in words what each is.

        Each is made from the user's initial guess, which is on the model whenever this goes on. Where there is no start
        at all, and no plan either, an InitialGuessError says why.
        """


def register_starts(provider: StartProvider) -> None:
    """Let plans start from what a provider proposes."""
    _REGISTERED.append(provider)


@cache
def _loaded() -> None:
    """Import what registers itself."""
    contrib = find_spec(CONTRIB)
    for folder in iter_modules(contrib.submodule_search_locations if contrib is not None else ()):
        if folder.ispkg and find_spec(f"{CONTRIB}.{folder.name}.start_provider") is not None:
            import_module(f"{CONTRIB}.{folder.name}.start_provider")


def fitting_providers(model: Any) -> list[tuple[StartProvider, Fit]]:
    """The providers that know starts for a model."""
    _loaded()
    found = [(provider, provider.fits(model)) for provider in _REGISTERED]
    fitting = [(provider, fit) for provider, fit in found if fit is not None]
    return [(provider, fit) for provider, fit in fitting if fit.obeys_equations] or fitting
