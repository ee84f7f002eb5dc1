"""A Pyomo model as numbers: a nonlinear program with derivatives by ASL, by CasADi, or from vectorised expressions."""
