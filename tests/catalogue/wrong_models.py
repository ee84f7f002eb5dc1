"""A catalogue of wrong models: what people state by mistake, and who has to say so, in which words."""

from . import wrong_data, wrong_equations, wrong_statements
from .entries import ENTRIES

# Importing them has entered their mistakes.
SOURCES = (wrong_statements, wrong_equations, wrong_data)
WRONG_MODELS = dict(ENTRIES)
