"""All sequences of modes that are allowed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from pyrobocop_pyomo.errors import ModelError

ModeSequence = tuple[str, ...]
Allowed = Callable[[str, str], bool] | Mapping[str, Iterable[str]]


def mode_sequences(
    modes: Iterable[str], length: int | Iterable[int], *, allowed: Allowed | None = None
) -> list[ModeSequence]:
    """All sequences of modes of a length, or of several lengths, whose successions are allowed.

    Parameters
    ----------
    modes : iterable of str
        Their names; of a dictionary, its keys.
    length : int or iterable of int
        Number of modes in a sequence, such as ``3`` or ``range(1, 4)``.
    allowed : callable or mapping, optional
        ``allowed(before, after)`` says whether one mode may follow another; or {mode: the modes that may follow it}.
        By default every mode may follow every mode, itself included.

    Returns
    -------
    list of tuple of str
        The shortest first, otherwise in the order of ``modes``; an ordinary list, to be filtered further.

    Raises
    ------
    ModelError
        When a mode stands twice or is unknown, a length is not positive, or nothing is left.

    Examples
    --------
    >>> mode_sequences(["stick", "slip"], 2, allowed=lambda before, after: before != after)
    [('stick', 'slip'), ('slip', 'stick')]
    """
    names = list(modes)
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise ModelError(f"mode '{twice}' is named twice; each mode needs a name of its own.")
    lengths = [length] if isinstance(length, int) else sorted(set(length))
    for each in lengths:
        if not isinstance(each, int) or each < 1:
            raise ModelError(f"length = {each!r}; a sequence has at least one mode.")
    followers = {name: _followers(name, names, allowed) for name in names}
    sequences: list[ModeSequence] = []
    grown: list[ModeSequence] = [(name,) for name in names]
    # Grown one by one, and not filtered out of the product, whose size may explode where few successions are allowed.
    for count in range(1, max(lengths, default=0) + 1):
        if count > 1:
            grown = [(*sequence, name) for sequence in grown for name in followers[sequence[-1]]]
        if count in lengths:
            sequences += grown
    if not sequences:
        raise ModelError(f"no sequence of {', '.join(map(repr, names)) or 'no modes'} has the length {length!r}.")
    return sequences


def _followers(name: str, names: list[str], allowed: Allowed | None) -> list[str]:
    if allowed is None:
        return names
    if not isinstance(allowed, Mapping):
        return [other for other in names if allowed(name, other)]
    given = set(allowed.get(name, ()))
    unknown = sorted({*given, *allowed} - set(names))
    if unknown:
        raise ModelError(f"allowed= names the mode {unknown[0]!r}; the modes are {', '.join(map(repr, names))}.")
    return [other for other in names if other in given]
