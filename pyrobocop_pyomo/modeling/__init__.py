"""What every kind of component here is built on: blocks, rules, variables and rows of any Pyomo model."""
