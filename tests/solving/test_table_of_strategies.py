"""The table of strategies: a page shows it, a person can read it, and every row says for which figure it is there."""

from pathlib import Path

import pyrobocop_pyomo
from pyrobocop_pyomo.solving.strategies import STRATEGIES, Strategy

PAGE = Path(pyrobocop_pyomo.__file__).parents[1] / "docs" / "explanation" / "second-tries.md"
MODELS = {True: "pairs", False: "no pairs", None: "both"}
HEADER = "| strategy | models | starts from | follows | its figure |\n|---|---|---|---|---|"


def row_of_page(strategy: Strategy) -> str:
    ends = sorted({end.name.lower().replace("_", " ") for end in strategy.follows})
    follows = ", ".join(ends) if ends else "is the first"
    models, start = MODELS[strategy.for_pairs], strategy.start.value
    return f'| `"{strategy.name}"` | {models} | {start} | {follows} | {strategy.figure} |'


def test_the_page_has_the_table() -> None:
    table = "\n".join([HEADER, *map(row_of_page, STRATEGIES)])
    assert table in PAGE.read_text(encoding="utf-8"), table


def test_the_table_fits_on_one_screen_and_each_row_has_its_figure() -> None:
    assert len(STRATEGIES) <= 14
    assert len({strategy.name for strategy in STRATEGIES}) == len(STRATEGIES)
    assert all(strategy.figure for strategy in STRATEGIES)
    assert [strategy.name for strategy in STRATEGIES if not strategy.follows] == ["barrier", "solve"]
