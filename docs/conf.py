"""Sphinx settings; build with ``python -m sphinx -W -b html docs docs/_build/html``."""

import os
from importlib.util import find_spec

import pyrobocop_pyomo

project = "pyrobocop_pyomo"
author = "the pyrobocop_pyomo developers"
copyright = "2026, the pyrobocop_pyomo developers"  # Sphinx reads this name
release = pyrobocop_pyomo.__version__

extensions = [
    "myst_nb",  # and with it myst_parser
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx_reredirects",
]
exclude_patterns = ["_build"]

nb_execution_mode = "off"  # the notebooks hold their outputs; tests/notebooks executes them
nb_merge_streams = True  # lines printed between two signs of progress are one block

myst_enable_extensions = ["dollarmath", "deflist", "amsmath", "colon_fence"]
myst_heading_anchors = 3
myst_dmath_double_inline = True

# Formulas render without a network: MathJax is copied from this package, which is no extension here. The variant that
# draws in SVG needs no fonts.
offline = os.path.dirname(find_spec("sphinx-mathjax-offline").origin)
html_static_path = ["_static", os.path.join(offline, "static", "mathjax", "tex-svg-full.js")]
html_css_files = ["custom.css"]
mathjax_path = "tex-svg-full.js"

# Code has a copy button, and what it prints has none.
copybutton_selector = "div:not(.highlight-output, .highlight-myst-ansi) > div.highlight > pre"
copybutton_prompt_text = r">>> |\.\.\. "
copybutton_prompt_is_regexp = True

math_number_all = False
math_eqref_format = "({number})"

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say it in words, with shapes and units
napoleon_google_docstring = False
napoleon_use_rtype = False
default_role = "code"  # a single backtick in a docstring names code
# Types in docstrings are words, such as "number". Sphinx takes them for names, and some attributes have these names.
suppress_warnings = ["ref.python"]

html_theme = "furo"
html_baseurl = os.environ.get("READTHEDOCS_CANONICAL_URL", "")  # where a host serves several versions
html_title = f"pyrobocop_pyomo {release}"

# Pages that were joined to others, or moved: the old address leads to the section, whose label is the old name.
redirects = (
    {
        f"how-to/{old}": f"{new}.html#{old}"
        for new, pages in {
            "certified-solutions": ["sweep"],
            "complementarity": ["relaxations"],
            "contact-laws": ["contact-with-impacts", "simulate-contact"],
            "estimation": ["data"],
            "failed-solves": ["diagnose"],
            "from-other-packages": ["from-casadi", "from-pyomo-dae", "from-pyrobocop"],
            "mesh-refinement": ["choosing-a-scheme"],
            "obstacles": ["maps-and-robots"],
            "phases": ["delays"],
            "solvers": ["faster-evaluation", "faster-linear-solver"],
            "switches": ["integer-controls"],
            "trajectories": ["initial-guesses", "notebooks"],
            "vectors": ["numpy"],
        }.items()
        for old in pages
    }
    | {
        f"explanation/{page}": f"../developer/{page}.html"
        for page in ("evaluation", "linear-solver", "problem-classes", "python-functions")
    }
    | {"explanation/complementarity-benchmarks": "../complementarity-benchmarks.html"}
)
