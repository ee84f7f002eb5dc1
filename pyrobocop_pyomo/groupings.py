"""Which products of complementary sides share one row: values of `grouping=`."""

from pyrobocop_pyomo.complementarity import AllPairs, Crossed, Grouping, PerElement, PerPair, PerPhase

__all__ = ["AllPairs", "Crossed", "Grouping", "PerElement", "PerPair", "PerPhase"]
