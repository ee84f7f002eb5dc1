"""Blocks of this package: scalar and indexed, built from arguments or by a rule, whole or not at all, picklable.

A kind of block is two classes, as everywhere in Pyomo: one for the data of a single block, which has what can be said
to it, and one for the component, which has the arguments::

    class DampersData(BuiltBlockData):
        def _build(self, stiffness): ...

    class Dampers(BuiltBlock, data=DampersData):
        def __init__(self, *indexes, stiffness=1.0, rule=None, **block_options):
            super().__init__(*indexes, options={"stiffness": stiffness}, rule=rule, **block_options)
"""

from __future__ import annotations

import copy
import inspect
from collections.abc import Callable, Container, Hashable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ClassVar, TypeVar

from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.block import Block, BlockData
from pyomo.core.base.global_set import UnindexedComponent_index, UnindexedComponent_set

from pyrobocop_pyomo.errors import ModelError
from pyrobocop_pyomo.presentation import Presented, preformatted

from .failures import undone_on_failure
from .keywords import check_keywords
from .pickling import picklable_or_none

Rule = Callable[..., Any]

_KEYWORD = inspect.Parameter.KEYWORD_ONLY
_OF_EVERY_BLOCK = (
    inspect.Parameter("concrete", _KEYWORD, default=False, annotation="bool"),
    inspect.Parameter("dense", _KEYWORD, default=True, annotation="bool"),
    inspect.Parameter("name", _KEYWORD, default=None, annotation="str | None"),
    inspect.Parameter("doc", _KEYWORD, default=None, annotation="str | None"),
)


class BuiltBlockData(Presented, BlockData):
    """One block that is built once, and on any error not at all.

    Subclasses say what they are (`_kind`), what they raise (`_error`) and how they are built (`_build`, which sets
    `_record`: the facts behind the block that are no Pyomo components).
    """

    _kind: ClassVar[str] = "block"
    _error: ClassVar[type[ModelError]] = ModelError
    # What other packages call its keywords -> the keyword.
    _other_words: ClassVar[Mapping[str, str]] = {}

    def __init__(self, component: Any) -> None:
        super().__init__(component)
        self._record: Any = None

    @property
    def is_built(self) -> bool:
        """True once everything is stated."""
        return self._record is not None

    @property
    def _what(self) -> str:
        return f"{self._kind} '{self.name}'"

    @property
    def can_follow_times(self) -> bool:
        """True for a block that can be stated anew, in its own components, when the times below it change."""
        return False

    def stands_on(self, sets: Container[int]) -> bool:
        """True where the block is over one of the sets, which are given by their identities."""
        return False

    def follow_times(self) -> None:
        """State the block anew, after the sets or the variables below it have changed."""
        raise NotImplementedError

    def _shown_as(self) -> str:
        component = self.parent_component()
        return type(self).__name__ if component is None else type(component).__bases__[-1].__name__

    def _summary(self) -> str:
        return f"'{self.name}'{'' if self.is_built else ', not constructed yet'}"

    def _repr_html_(self) -> str:
        return preformatted(repr(self))  # the text of a block is its name

    def _build(self, *arguments: Any, **options: Any) -> None:
        raise NotImplementedError

    def _build_once(self, *arguments: Any, **options: Any) -> None:
        if self.is_built:
            raise self._error(f"{self._what} is built already.")
        component = self.parent_component()
        what = type(component).__bases__[-1].__name__
        check_keywords(what, options, component._keywords, self._error, self._other_words)
        with self._all_or_nothing(), PauseGC():
            self._build(*arguments, **options)

    def _record_if_built(self, error: type[ModelError] | None = None) -> Any:
        if self._record is None:
            raise (error or self._error)(
                f"{self._what} is not constructed yet: add it to a ConcreteModel first, as in model.{self._kind} = "
                "..., and state what belongs to it then."
            )
        return self._record

    @contextmanager
    def _all_or_nothing(self) -> Iterator[None]:
        """On any error, remove what was added since: nothing half-built stays on the user's model."""
        components = set(self.component_map())
        record = None if self._record is None else snapshot_of(self._record)

        def remove_what_was_added() -> None:
            for name in [name for name in self.component_map() if name not in components]:
                self.del_component(name)
            self._record = record

        with undone_on_failure(remove_what_was_added):
            yield


class BlockRule:
    """The rule that Pyomo calls for every block: our build, then the user's own rule.

    A class, because it must survive pickling.

    Parameters
    ----------
    arguments : tuple
        Positional arguments of the build.
    options : mapping or None
        Keywords of the build; None where the user's rule asks for the build.
    rule : callable or None
    """

    def __init__(self, arguments: tuple[Any, ...], options: Mapping[str, Any] | None, rule: Rule | None) -> None:
        self.arguments = arguments
        self.options = options
        self.rule = rule

    def __call__(self, block: Any, *index: Hashable) -> None:
        """Build one block."""
        if self.options is not None:
            block._build_once(*self.arguments, **self.options)
        if self.rule is not None:
            # Pyomo passes the index None to a rule of a scalar block that takes any number of arguments.
            self.rule(block, *(index if block.parent_component().is_indexed() else ()))
        if not block.is_built:
            raise block._error(f"'{block.name}': its rule has to call block.build(points, ...), and did not.")

    def __deepcopy__(self, memo: dict[int, Any]) -> BlockRule:
        def copied(option: Any) -> Any:
            return copy.deepcopy(option, memo) if _is_of_model(option) else option  # the rest stays the user's own

        options = self.options and {name: copied(option) for name, option in self.options.items()}
        return BlockRule(tuple(map(copied, self.arguments)), options, self.rule)

    def __getstate__(self) -> dict[str, Any]:
        # Blocks that are built need none of the functions again; others need functions that a pickle can hold.
        options = self.options and {name: _for_pickle(option) for name, option in self.options.items()}
        arguments = tuple(map(_for_pickle, self.arguments))
        return {"arguments": arguments, "options": options, "rule": picklable_or_none(self.rule)}


class BuiltBlock(Block):
    """Component of the blocks of one kind; on any error while it is built, it leaves the model again.

    A subclass names the class of its data, and gets a scalar and an indexed class of its own. Its signature, and what
    its blocks offer, are shown by ``help``.
    """

    _keywords: ClassVar[tuple[str, ...]] = ()
    _scalar: ClassVar[type]
    _indexed: ClassVar[type]

    def __init_subclass__(cls, data: type[BuiltBlockData] | None = None, **options: Any) -> None:
        super().__init_subclass__(**options)
        if data is None:  # the scalar or the indexed class of a kind
            return
        cls._ComponentDataClass = data
        own = [p for p in list(inspect.signature(cls.__init__).parameters.values())[1:] if p.kind is not p.VAR_KEYWORD]
        cls.__signature__ = inspect.Signature([*own, *_OF_EVERY_BLOCK])
        cls._keywords = tuple(p.name for p in cls.__signature__.parameters.values() if p.kind is _KEYWORD)
        if (build := vars(data).get("build")) is not None:
            first_two = list(inspect.signature(build).parameters.values())[:2]
            options_of_build = [p for p in own if p.kind is _KEYWORD and p.name != "rule"]
            build.__signature__ = inspect.Signature([*first_two, *options_of_build])
        for name, member in _offered(data):
            setattr(cls, name, _OfOneBlock(name, member))

        def init_scalar(self: Any, *args: Any, **keywords: Any) -> None:
            data.__init__(self, component=self)
            cls.__init__(self, *args, **keywords)
            self._data[None] = self
            self._index = UnindexedComponent_index

        cls._scalar = _variant(cls, "scalar", (data, cls), __init__=init_scalar, display=Block.display)
        cls._indexed = _variant(cls, "indexed", (cls,))

    def __new__(cls, *args: Any, **keywords: Any) -> Any:
        """Choose the scalar or the indexed class; refuse a misspelt keyword before anything is built."""
        of_data = cls._ComponentDataClass
        check_keywords(cls.__name__, keywords, cls._keywords, of_data._error, of_data._other_words)
        if "_scalar" in cls.__dict__:
            cls = cls._scalar if cls._is_scalar(args, keywords) else cls._indexed
        # Past Block.__new__, which knows only its own two classes.
        return super(Block, cls).__new__(cls)

    def __init__(
        self,
        *indexes: Any,
        arguments: tuple[Any, ...] = (),
        options: Mapping[str, Any] | None = None,
        rule: Rule | None = None,
        **block_options: Any,
    ) -> None:
        super().__init__(*indexes, rule=BlockRule(arguments, options, rule), **block_options)

    @classmethod
    def _is_scalar(cls, args: tuple[Any, ...], keywords: Mapping[str, Any]) -> bool:
        """True where the positional arguments are no index sets."""
        return not args or (args[0] is UnindexedComponent_set and len(args) == 1)

    def construct(self, data: Any = None) -> None:
        """Build the block; on any error, the user's own included, take it off the model."""
        with undone_on_failure(self._take_off):
            super().construct(data)

    def _take_off(self) -> None:
        parent = self.parent_block()
        if parent is not None and parent.component(self.local_name) is self:
            parent.del_component(self)


class _OfOneBlock:
    """What one block offers, on the class of the component too, where ``help`` and completion look for it."""

    def __init__(self, name: str, member: Any) -> None:
        self.name = name
        self.member = member

    def __get__(self, component: Any, owner: type | None = None) -> Any:
        if component is None:
            return self.member
        raise AttributeError(
            f"'{component.local_name}' is indexed; '{self.name}' belongs to one of its blocks: "
            f"{component.local_name}[...].{self.name}."
        )


Record = TypeVar("Record")


def snapshot_of(record: Record) -> Record:
    """A copy of a record that later additions to its dicts, lists and sets do not reach."""
    duplicate = copy.copy(record)
    for name, held in vars(record).items():
        if isinstance(held, (dict, list, set)):
            setattr(duplicate, name, copy.copy(held))
    return duplicate


def blocks_of_kind(model: Any, kind: type[BuiltBlockData] | tuple[type[BuiltBlockData], ...]) -> list[Any]:
    """The active blocks of a kind, or of several, on a model, wherever they are; the model itself may be one."""
    found = model.block_data_objects(active=True, descend_into=Block)
    return [block for block in found if isinstance(block, kind)]


def _offered(data: type[BuiltBlockData]) -> Iterator[tuple[str, Any]]:
    """Public methods and properties of a data class that its component does not have."""
    for base in data.__mro__[: data.__mro__.index(BlockData)]:
        for name, member in vars(base).items():
            if not name.startswith("_") and not hasattr(Block, name):
                yield name, member


def _variant(cls: type, kind: str, bases: tuple[type, ...], **members: Any) -> type:
    """The scalar or the indexed class; pickles find it by its qualified name, as an attribute of the class."""
    place = {"__module__": cls.__module__, "__qualname__": f"{cls.__qualname__}._{kind}", "__doc__": cls.__doc__}
    return type(cls)(f"{kind.capitalize()}{cls.__name__}", bases, {**place, **members})


def _for_pickle(option: Any) -> Any:
    """The option, or None for a function that a pickle cannot hold."""
    return picklable_or_none(option) if callable(option) and not _is_of_model(option) else option


def _is_of_model(option: Any) -> bool:
    """True for components, expressions and sequences of them."""
    if isinstance(option, (tuple, list)):
        return any(map(_is_of_model, option))
    return hasattr(option, "ctype") or hasattr(option, "is_expression_type")
