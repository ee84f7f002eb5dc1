"""What relaxing a pair costs, beside the bare expressions and beside Pyomo's own transformation.

    python benchmarks/complementarity_cost.py [--quick]

20 000 pairs of plain variables, and of affine sides. Microseconds of processor time per pair (the smallest of several
runs; processor time and not wall time, since other work may share the machine): to make the bare expressions of the
products, and of the definitions where sides are lifted, with nothing around them; to write the rows and variables that
end on the model by hand, as indexed components with rules; to bring the pairs into canonical form, to apply and to
revert; and kilobytes per pair that stay (in a run of its own, since measuring memory takes time). "beyond" is what
applying costs beyond the bare expressions. The last rows are Pyomo's ``mpec.simple_nonlinear``, which has no way back.
"""

from __future__ import annotations

import argparse
import gc
import time
import tracemalloc
from collections.abc import Callable
from typing import Any

import pyomo.environ as pyo
import pyomo.mpec as mpec
from table import Table, show_progress

import pyrobocop_pyomo as rcp

WAYS: dict[str, dict[str, Any] | None] = {
    "pair, scholtes": {},
    "pair, scholtes, lifted": {"lift": True},
    "element, scholtes": {"grouping": "element"},
    "pair, fischer-burmeister": {"relaxation": "fischer-burmeister"},
    "pair, fischer-burmeister, lifted": {"relaxation": "fischer-burmeister", "lift": True},
    "mpec.simple_nonlinear": None,
}


def sides(m: Any, affine: bool, i: int) -> tuple[Any, Any]:
    """The expressions of one pair."""
    return (2 * m.x[i] - m.y[i] + 1, m.x[i] + 3 * m.y[i] - 1) if affine else (m.x[i], m.y[i])


def stated(pairs: int, affine: bool, complements: Any, component: Any) -> Any:
    """A model with pairs, ten to an element."""
    m = pyo.ConcreteModel()
    m.i = pyo.RangeSet(pairs)
    m.x, m.y = (pyo.Var(m.i, bounds=(0, None), initialize=1.0) for _ in range(2))
    options = {"group": lambda m, i: i // 10} if component is rcp.Complementarity else {}

    def rule(m: Any, i: int) -> Any:
        a, b = sides(m, affine, i)
        return complements(a >= 0, b >= 0)

    m.pairs = component(m.i, rule=rule, **options)
    m.cost = pyo.Objective(expr=m.x[1])
    return m


def least(runs: int, prepare: Callable[[], Any], do: Callable[[Any], Any]) -> float:
    """Processor seconds of the quickest run."""
    best = float("inf")
    for _ in range(runs):
        given = prepare()
        gc.collect()
        gc.disable()  # the collector would be counted for whoever happens to trigger it
        started = time.process_time()
        do(given)
        best = min(best, time.process_time() - started)
        gc.enable()
    return best


def product(a: Any, b: Any, roots: bool) -> Any:
    """What bounds the product of a pair."""
    return rcp.relaxations.FischerBurmeister().residual(a, b, 1e-2) <= 0 if roots else a * b <= 1e-2


def bare(m: Any, affine: bool, lifted: bool, roots: bool) -> list[Any]:
    """Nothing but the expressions that a relaxed model has to hold."""
    if affine and lifted:
        rows = []
        for i in m.i:
            a, b = sides(m, affine, i)
            s, t = m.x[i], m.y[i]  # as costly as the variables that would stand for the sides
            rows += [product(s, t, roots), s == a, t == b]
        return rows
    return [product(*sides(m, affine, i), roots) for i in m.i]


def by_hand(m: Any, affine: bool, lifted: bool, roots: bool, by_element: bool) -> None:
    """The rows and variables that a relaxed model holds, as a user writes them."""
    pairs = {i: sides(m, affine, i) for i in m.i}
    if affine and lifted:
        m.s, m.t = pyo.Var(m.i, within=pyo.NonNegativeReals), pyo.Var(m.i, within=pyo.NonNegativeReals)
        m.first = pyo.Constraint(m.i, rule=lambda m, i: m.s[i] == pairs[i][0])
        m.second = pyo.Constraint(m.i, rule=lambda m, i: m.t[i] == pairs[i][1])
        m.products = pyo.Constraint(m.i, rule=lambda m, i: product(m.s[i], m.t[i], roots))
        return
    if affine:
        m.first = pyo.Constraint(m.i, rule=lambda m, i: pairs[i][0] >= 0)
        m.second = pyo.Constraint(m.i, rule=lambda m, i: pairs[i][1] >= 0)
    if by_element:

        def summed(m: Any, k: int) -> Any:
            members = (pairs[10 * k + j + 1] for j in range(10))
            return pyo.quicksum([a * b for a, b in members]) <= 1e-2

        m.products = pyo.Constraint(range(len(m.i) // 10), rule=summed)
    else:
        m.products = pyo.Constraint(m.i, rule=lambda m, i: product(*pairs[i], roots))


def kilobytes(m: Any, apply: Callable[[Any], Any]) -> float:
    """What an application leaves in memory."""
    gc.collect()
    tracemalloc.start()
    kept = apply(m)
    gc.collect()
    size, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    del kept
    return size / 1024


def measured(way: str, affine: bool, pairs: int, runs: int) -> tuple[float | None, ...]:
    """One row: bare, by hand, canonical, apply, beyond, revert, memory; all per pair."""
    options = WAYS[way]
    scale = 1e6 / pairs

    def ours() -> Any:
        return stated(pairs, affine, rcp.complements, rcp.Complementarity)

    lifted, roots = "lifted" in way, "fischer" in way
    expressions = least(runs, ours, lambda m: bare(m, affine, lifted, roots)) * scale
    written = least(runs, ours, lambda m: by_hand(m, affine, lifted, roots, "element" in way)) * scale
    if options is None:
        stock = pyo.TransformationFactory("mpec.simple_nonlinear")

        def theirs() -> Any:
            return stated(pairs, affine, mpec.complements, mpec.Complementarity)

        applied = least(runs, theirs, stock.apply_to) * scale
        return (
            expressions,
            written,
            None,
            applied,
            applied - expressions,
            None,
            kilobytes(theirs(), stock.apply_to) / pairs,
        )
    relax = pyo.TransformationFactory("pyrobocop.relax_complementarity")

    def apply(m: Any) -> Any:
        return relax.apply_to(m, **options)

    def relaxed() -> tuple[Any, Any]:
        m = ours()
        return m, apply(m)

    canonical = least(runs, ours, rcp.active_pairs) * scale
    applied = least(runs, ours, apply) * scale
    reverted = least(runs, relaxed, lambda given: relax.revert(*given)) * scale
    return expressions, written, canonical, applied, applied - expressions, reverted, kilobytes(ours(), apply) / pairs


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="500 pairs, one run each")
    quick = parser.parse_args().quick
    pairs, runs = (500, 1) if quick else (20000, 3)
    print(f"{pairs} pairs; microseconds and kilobytes per pair\n")
    table = Table(
        [
            ("sides", "<9"),
            ("way", "<32"),
            ("bare", ">6.1f"),
            ("by hand", ">7.1f"),
            ("canonical", ">9.1f"),
            ("apply", ">6.1f"),
            ("beyond", ">6.1f"),
            ("revert", ">6.1f"),
            ("kB", ">5.2f"),
        ]
    )
    table.header()
    for affine in (False, True):
        for way in WAYS:
            show_progress(way)
            row = measured(way, affine, pairs, runs)
            show_progress("")
            table.add("affine" if affine else "variables", way, *row)


if __name__ == "__main__":
    main()
