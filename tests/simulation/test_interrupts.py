"""Ctrl-C in the middle of a step, and again while one waits: when the step returns, nobody writes any more."""

import signal
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from magwire_env import Scenario, Simulator
from magwire_env.simulation.threads import share_out


@pytest.fixture
def alarms() -> Iterator[Callable[[float, int], None]]:
    """Call it to be interrupted after so many s, and so many times, 30 ms apart."""
    left = [0]

    def interrupt(*_) -> None:
        left[0] -= 1
        if left[0] <= 0:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        raise KeyboardInterrupt

    def ask(first: float, times: int) -> None:
        left[0] = times
        signal.setitimer(signal.ITIMER_REAL, first, 0.03 if times > 1 else 0.0)

    before = signal.signal(signal.SIGALRM, interrupt)
    yield ask
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("first", [0.02, 0.05])
def test_interrupts_while_another_thread_still_works(alarms, first):
    written = []

    def run(blocks: np.ndarray, slow: bool) -> None:
        if slow:
            time.sleep(0.2)
            written.append(time.perf_counter())

    alarms(first, 2)
    with pytest.raises(KeyboardInterrupt):
        share_out(run, np.arange(16), [False, True], 2)
    returned = time.perf_counter()
    time.sleep(0.3)
    assert len(written) == 1
    assert written[0] <= returned


def test_an_interrupted_step_is_a_whole_one(alarms):
    command = np.full((1024, 1), 4.0)
    sim, rng = Simulator(Scenario.paper(), num_envs=1024, threads=2), np.random.default_rng(0)
    sim.step(command)
    start, began = sim.state(), time.perf_counter()
    sim.step(command)
    took, moved = time.perf_counter() - began, sim.state()
    whole = 0

    def until_interrupted() -> None:
        alarms(rng.uniform(1e-5, took), 1)
        for _ in range(1000):
            sim.load_state(start)
            sim.step(command)

    for _ in range(60):
        with pytest.raises(KeyboardInterrupt):
            until_interrupted()
        left = sim.state()
        time.sleep(took)
        assert sim.state() == left  # nobody wrote meanwhile
        whole += left == moved
        sim.load_state(start)
        sim.step(command)
        assert sim.state() == moved
    assert whole > 5
