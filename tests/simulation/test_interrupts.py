"""Ctrl-C in the middle of a step, and again while one waits: when the step returns, nobody writes any more."""

import signal
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

import numpy as np
import pytest

from magwire_env import Scenario, Simulator
from magwire_env.simulation.threads import share_out


@pytest.fixture
def two_interrupts() -> Iterator[Callable[[float, float], None]]:
    """Call it to be interrupted after so many s, and then once more after so many."""
    second = [0.0]

    def interrupt(*_) -> None:
        signal.setitimer(signal.ITIMER_REAL, second[0])
        second[0] = 0.0
        raise KeyboardInterrupt

    def ask(first: float, after: float) -> None:
        second[0] = after
        signal.setitimer(signal.ITIMER_REAL, first)

    before = signal.signal(signal.SIGALRM, interrupt)
    yield ask
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("first", [0.02, 0.05])
def test_two_interrupts_while_a_thread_still_works(two_interrupts, first):
    written = []

    def run(blocks: np.ndarray, slow: bool) -> None:
        if slow:
            time.sleep(0.2)
            written.append(time.perf_counter())

    two_interrupts(first, 0.03)
    with pytest.raises(KeyboardInterrupt):
        share_out(run, np.arange(16), [False, True], 2)
    returned = time.perf_counter()
    time.sleep(0.3)
    assert len(written) == 1
    assert written[0] <= returned


def test_a_step_after_an_interrupted_one_is_right(two_interrupts):
    command = np.full((1024, 1), 4.0)
    sim, rng = Simulator(Scenario.paper(), num_envs=1024, threads=2), np.random.default_rng(0)
    sim.step(command)
    start, began = sim.state(), time.perf_counter()
    sim.step(command)
    took, moved = time.perf_counter() - began, sim.state()
    hits = 0
    for _ in range(60):
        sim.load_state(start)
        try:
            two_interrupts(rng.uniform(1e-5, 0.5 * took), 1e-5)
            for _ in range(100):
                sim.step(command)
        except KeyboardInterrupt:
            hits += 1
        with suppress(KeyboardInterrupt):
            time.sleep(1e-3)  # for the second one, if it did not come
        sim.load_state(start)
        sim.step(command)
        assert sim.state() == moved
    assert hits == 60
