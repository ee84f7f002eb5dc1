"""Sequences of modes: all that are allowed, in one order."""

from __future__ import annotations

import itertools
from typing import Any

import pytest

import pyrobocop_pyomo as rcp
from pyrobocop_pyomo.errors import ModelError

GAINS = {"slow": 1.0, "fast": 2.0, "back": -1.0}


def test_all_sequences_come_in_the_order_of_the_modes() -> None:
    assert rcp.studies.mode_sequences("ab", 2) == [("a", "a"), ("a", "b"), ("b", "a"), ("b", "b")]
    assert rcp.studies.mode_sequences(GAINS, [2, 1])[:3] == [("slow",), ("fast",), ("back",)]
    assert len(rcp.studies.mode_sequences(GAINS, range(1, 5))) == 3 + 9 + 27 + 81


@pytest.mark.parametrize("length", [1, 2, 3, 4])
def test_successions_are_those_of_the_filtered_product(length: int) -> None:
    follow = {"a": "bc", "b": "a", "c": "ca"}
    expected = [
        sequence
        for sequence in itertools.product("abc", repeat=length)
        if all(after in follow[before] for before, after in itertools.pairwise(sequence))
    ]
    assert rcp.studies.mode_sequences("abc", length, allowed=lambda before, after: after in follow[before]) == expected


def test_rare_successions_do_not_cost_the_whole_product() -> None:
    modes = [str(i) for i in range(40)]
    found = rcp.studies.mode_sequences(modes, 30, allowed=lambda *pair: pair in {("0", "1"), ("1", "0")})
    assert found == [("0", "1") * 15, ("1", "0") * 15]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((["a", "a"], 1), "mode 'a' is named twice"),
        ((["a"], 0), "length = 0; a sequence has at least one mode"),
        ((["a"], [1, 2.5]), "length = 2.5"),
        (([], 1), "no sequence of no modes has the length 1"),
        ((["a"], []), r"no sequence of 'a' has the length \[\]"),
        ((["a", "b"], 2, lambda *_: False), "no sequence of 'a', 'b' has the length 2"),
    ],
)
def test_what_makes_no_sequence_is_refused(arguments: Any, message: str) -> None:
    modes, length, *allowed = arguments
    with pytest.raises(ModelError, match=message):
        rcp.studies.mode_sequences(modes, length, allowed=allowed[0] if allowed else None)
