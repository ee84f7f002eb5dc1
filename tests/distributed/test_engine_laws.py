"""Whatever workers die, and whenever: the agents' reports are those of an undisturbed run, to the last bit."""

import pickle
from collections.abc import Callable, Collection, Sequence
from concurrent.futures import Future

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tiny_agents import NAMES, SPECS, TinyOrder, TinySpec, contradiction, missing_data, noise, play, undisturbed

from pyrobocop_pyomo.errors import EngineError, ModelError
from pyrobocop_pyomo.execution import worker_host
from pyrobocop_pyomo.execution.engine import AgentFailure, Engine
from pyrobocop_pyomo.execution.engines import SerialEngine, find_engine
from pyrobocop_pyomo.execution.process_engine import ProcessEngine
from pyrobocop_pyomo.execution.tasks import Task, run_tasks
from pyrobocop_pyomo.execution.worker_host import Answer, Request, WorkerHost
from pyrobocop_pyomo.modeling.deadline import Deadline


class FragileEngine(Engine):
    """Two places in this process. Before its n-th request, a place forgets all its agents if n is among its deaths."""

    name = "fragile"

    def __init__(self, deaths: Sequence[Collection[int]] = ((), ()), **options: int) -> None:
        super().__init__(2, **options)
        self.fatal = [set(times) for times in deaths]
        self.asked = [0, 0]

    def open(self, places: int) -> None:
        self.hosts = [WorkerHost() for _ in range(places)]

    def submit(self, request: Request) -> Future[Answer]:
        future: Future[Answer] = Future()
        self.asked[request.place] += 1
        if self.asked[request.place] in self.fatal[request.place]:
            self.hosts[request.place] = WorkerHost()
            future.set_exception(ConnectionError("on request"))
        else:
            future.set_result(self.hosts[request.place].answer(request))
        return future

    def close(self) -> None:
        pass


@pytest.fixture(scope="module")
def expected() -> list[dict]:
    return undisturbed(12)[0]


@given(deaths=st.tuples(*[st.sets(st.integers(3, 40), max_size=5)] * 2))
@settings(max_examples=60)
def test_deaths_change_nothing(expected: list[dict], deaths: tuple[set[int], set[int]]) -> None:
    engine = FragileEngine(deaths, deaths_allowed=1000)
    engine.start(SPECS)
    assert play(engine, 12) == expected


@given(rounds=st.integers(0, 12), death=st.integers(3, 40))
@settings(max_examples=30)
def test_states_are_all_that_is_needed_to_go_on(expected: list[dict], rounds: int, death: int) -> None:
    first = SerialEngine()
    first.start(SPECS)
    play(first, rounds)
    states = pickle.loads(pickle.dumps(first.states()))
    second = FragileEngine(({death}, ()))
    second.start(SPECS)
    second.restore(states)
    if 0 < rounds < 12:
        assert play(second, 12, first=rounds) == expected[rounds:]


def doubling() -> Callable[..., int]:
    """What does tasks of which each asks for another, until they are large enough."""
    return lambda number, *, deadline: 2 * number


def doubled(engine: Engine | None) -> tuple[set[int], set[str]]:
    """Results, and keys of tasks that were given up."""
    results: set[int] = set()
    given_up: set[str] = set()

    def take(key: str, result: int | None) -> list[Task]:
        if result is None:
            given_up.add(key)
            return []
        assert result not in results
        results.add(result)
        return [Task(str(result), (result,))] if result < 60 else []

    tasks = [Task(str(number), (number,)) for number in (1, 3, 5, 7)]
    run_tasks(tasks, take, make=doubling, engine=engine, most=9, deadline=Deadline.after(None))
    return results, given_up


@given(deaths=st.tuples(*[st.sets(st.integers(2, 30), max_size=4)] * 2))
@settings(max_examples=60)
def test_tasks_are_done_once_whatever_workers_die(deaths: tuple[set[int], set[int]]) -> None:
    """Each task has its result once, unless three workers died of it, and then it and what would follow have none."""
    engine = FragileEngine(deaths)
    expected, none = doubled(None)
    assert not none
    results, given_up = doubled(engine)
    lost = {2 * int(key) * 2**k for key in given_up for k in range(8)}
    assert results == expected - lost
    assert sum(map(len, deaths)) >= 3 * len(given_up)


def test_what_was_called_is_done_again() -> None:
    def end(deaths: Sequence[Sequence[int]]) -> dict:
        engine = FragileEngine(deaths)
        engine.start(SPECS)
        play(engine, 2)
        engine.call_all("shift", {"a": (2,)})
        engine.call_all("shift", {"b": (1,), "c": (3,)})
        play(engine, 2)
        return {name: state["x"].tolist() for name, state in engine.states().items()}

    assert end(((), (14,))) == end(((), ()))


def test_a_solve_that_raised_is_done_again() -> None:
    def end(deaths: Sequence[Sequence[int]]) -> tuple[AgentFailure, dict]:
        engine = FragileEngine(deaths)
        engine.start(SPECS)
        failure = engine.solve({"a": TinyOrder(np.ones(5), "raise")})["a"]
        engine.solve({"a": TinyOrder(np.ones(5))})
        return failure, engine.states()["a"]

    failure, state = end(((), (5,)))
    assert (failure.agent, failure.reason, failure.final) == ("a", "ArithmeticError: log(-1)", False)
    assert state["x"].tolist() == end(((), ()))[1]["x"].tolist()


def test_agents_whose_workers_die_too_often_are_given_up_and_the_others_go_on() -> None:
    engine = FragileEngine(((), range(5, 1000)), deaths_allowed=2)
    engine.start(SPECS)
    for _ in range(4):
        reports = engine.solve({name: TinyOrder(np.ones(5)) for name in NAMES})
    assert [isinstance(reports[name], AgentFailure) for name in NAMES] == [False, True, False, True]
    assert reports["a"].final
    assert "died 3 times" in reports["a"].reason
    assert list(engine.states()) == ["hub", "b"]
    with pytest.raises(EngineError, match="'a' is given up"):
        engine.restore({"a": {"x": np.zeros(5)}})
    engine.fatal = [set(), set()]
    engine.start(SPECS)  # all are well again
    assert not engine.deaths


def test_arrays_are_not_shared_with_the_coordinator() -> None:
    engine = SerialEngine()
    engine.start(SPECS)
    order = TinyOrder(np.ones(5))
    report = engine.solve({"a": order})["a"]
    report.values[:] = 7.0
    assert 7.0 not in engine.states()["a"]["x"]


def test_the_serial_engine_takes_any_builder() -> None:
    engine = SerialEngine()
    assert engine.start([TinySpec("a", lambda: np.ones(3), ())]) == {"a": {"name": "a", "size": 3}}


# ---------------------------------------------------------------- refused before any solve


def test_two_agents_with_one_name() -> None:
    with pytest.raises(EngineError, match="2 agents have the name 'a'"):
        ProcessEngine().start([TinySpec("a"), TinySpec("b"), TinySpec("a")])


def test_a_builder_without_a_name_travels_by_value_or_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    def inner() -> np.ndarray:
        return np.ones(2)

    monkeypatch.setattr(worker_host, "cloudpickle_available", False)
    for builder, data in ((lambda: np.ones(2), ()), (inner, ()), (noise, (0, lambda: 1))):
        with pytest.raises(EngineError, match="agent 'a' cannot be sent to another process .* top level of a module"):
            ProcessEngine().start([TinySpec("a", builder, data)])
    pytest.importorskip("cloudpickle")
    monkeypatch.undo()
    assert FragileEngine().start([TinySpec("a", inner, ())]) == {"a": {"name": "a", "size": 2}}


def test_what_a_worker_cannot_read_is_told() -> None:
    found = WorkerHost().answer(Request("a", b"cno_such_module\nbuilder\n.", 0, "a", method="facts"))
    assert found.raised
    assert "cannot read what was sent to it (ModuleNotFoundError" in found.raised


@pytest.mark.parametrize("engine", [SerialEngine, FragileEngine])
def test_a_builder_that_fails_is_told_with_its_agent(engine: type[Engine]) -> None:
    with pytest.raises(EngineError, match="agent 'b' could not be built: LookupError: there is no such file") as told:
        engine().start([TinySpec("a"), TinySpec("b", missing_data)])
    assert "missing_data" in str(told.value.__cause__)
    with pytest.raises(ModelError, match="longer than the field"):  # an error of this package keeps its class
        engine().start([TinySpec("a"), TinySpec("b", contradiction)])


def test_unknown_agents_methods_and_engines() -> None:
    engine = SerialEngine()
    with pytest.raises(EngineError, match="not started"):
        engine.solve({"a": TinyOrder(np.ones(5))})
    with pytest.raises(EngineError, match="no agents to start"):
        engine.start([])
    engine.start(SPECS)
    with pytest.raises(EngineError, match="no agent 'd'; the agents are hub, a, b, c"):
        engine.solve({"d": TinyOrder(np.ones(5))})
    with pytest.raises(EngineError, match="agent 'a' turn.. failed: AttributeError"):
        engine.call_all("turn", {"a": ()})
    with pytest.raises(ModelError, match="'a': .2,. values for .5,."):
        engine.restore({"a": {"x": np.zeros(2), "solves": np.array(0)}})
    engine.stop()
    with pytest.raises(EngineError, match="stopped"):
        engine.states()
    with pytest.raises(EngineError, match="engine = 'ray'; expected 'serial', 'process', 'dask', 'mpi'"):
        find_engine("ray")
    assert find_engine(engine) is engine
    with pytest.raises(EngineError, match="deaths_allowed = -1"):
        ProcessEngine(deaths_allowed=-1)
    with pytest.raises(EngineError, match="workers = 0"):
        ProcessEngine(0)
    with pytest.raises(EngineError, match="answer_within = 0"):
        ProcessEngine(answer_within=0)
