"""Complementarity in any Pyomo model: the component, its canonical form and its relaxations."""
