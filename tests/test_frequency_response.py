"""Frequency responses by eigenvectors are those of a factorisation per frequency, and quicker."""

import numpy as np
import pytest
import threadpoolctl
from quick import quick

import ambkit
from ambkit.base.threads import one_thread
from ambkit.judge.loop.loop_builder import LoopBuilder
from ambkit.judge.loop.margins import grid
from ambkit.models.linear import LinearSystem

MACHINES = ("heart_pump", "tum_mlps_flexible", "ufu_flexible")


def closed_loop(machine):
    """Return S of a preset's closed loop, and frequencies [Hz] at which no feature is left out."""
    loop = LoopBuilder(ambkit.Machine.preset(machine), None).loop(None)
    closed, m = loop.closed, loop.measurements
    names = [[signal.name for signal in of[:m]] for of in (closed.outputs, closed.inputs)]
    return closed.select(*names), grid(loop, points=60, near=5)


def by_factorisation(system, f):
    half = 1j * np.pi * f * system.T
    shift, A = 2 * np.exp(half) * np.sinh(half), system.A - np.eye(len(system.A))
    return [system.D + system.C @ np.linalg.solve(s * np.eye(len(A)) - A, system.B) for s in shift]


@pytest.mark.parametrize("machine", MACHINES)
def test_a_response_is_that_of_a_factorisation_per_frequency(machine):
    system, f = closed_loop(machine)
    found, expected = system.response(f), np.array(by_factorisation(system, f))
    off = np.abs(found - expected).max(axis=(1, 2)) / np.abs(expected).max(axis=(1, 2))
    assert off.max() < 1e-8


def test_it_takes_one_set_of_eigenvectors_and_no_factorisation(monkeypatch):
    system, f = closed_loop("tum_mlps_flexible")
    system.response(f[:1])
    solved = []
    solve = np.linalg.solve
    monkeypatch.setattr(np.linalg, "solve", lambda a, b: (solved.append(len(a)), solve(a, b))[1])
    system.response(f)
    assert sum(solved) < 0.05 * len(f), "those near z = 1 alone are factorised"


@pytest.mark.parametrize("machine", quick(MACHINES, MACHINES[1:2]))
def test_a_plant_with_a_dead_time_needs_no_factorisation_either(machine):
    late = ambkit.Machine.preset(machine)
    late = late.model_copy(update={"delay": 2.4 * late.sampling_time})
    loop = LoopBuilder(late).loop()
    system, f = loop.plant.part(slice(loop.measurements), slice(2)), grid(loop, 60, 5)
    assert system._modes is not None
    found, expected = system.response(f), np.array(by_factorisation(system, f))
    off = np.abs(found - expected).max(axis=(1, 2)) / np.abs(expected).max(axis=(1, 2))
    assert off.max() < 1e-8


def test_dependent_eigenvectors_of_a_dead_time_are_split_off():
    n = 12  # a dead time of many samples: one chain of states, all of whose poles are 0
    chain = LinearSystem(
        np.eye(n, k=-1), np.eye(n)[:, :1], np.eye(n)[-1:], np.zeros((1, 1)), 1e-4, (), (), ()
    )  # fmt: skip
    f = np.geomspace(1, 5000, 50)
    late = np.exp(-2j * np.pi * f * n * 1e-4)
    assert chain._modes is not None
    assert np.abs(chain.response(f)[:, 0, 0] - late).max() < 1e-12


def test_nearly_dependent_eigenvectors_are_not_used():
    n = 12  # a chain of low-passes, all of whose poles are 0.5
    chain = LinearSystem(
        0.5 * np.eye(n) + np.eye(n, k=-1), np.eye(n)[:, :1], np.eye(n)[-1:], np.zeros((1, 1)),
        1e-4, (), (), (),
    )  # fmt: skip
    assert chain._modes is None
    f = np.geomspace(1, 5000, 50)
    expected = (np.exp(2j * np.pi * f * 1e-4) - 0.5) ** -n
    assert np.abs(chain.response(f)[:, 0, 0] / expected - 1).max() < 1e-9


def test_units_of_the_states_change_nothing():
    system, f = closed_loop("heart_pump")
    size = 10.0 ** np.linspace(-9, 9, len(system.A))
    scaled = LinearSystem(
        system.A * size / size[:, None], system.B / size[:, None], system.C * size, system.D,
        system.T, system.states, system.inputs, system.outputs,
    )  # fmt: skip
    assert scaled._modes is not None
    assert np.abs(scaled.response(f) - system.response(f)).max() < 1e-9


def test_small_matrices_are_computed_in_one_thread_and_the_callers_number_comes_back():
    def threads():
        blas = [each for each in threadpoolctl.threadpool_info() if each["user_api"] == "blas"]
        return {each["num_threads"] for each in blas}

    import scipy.linalg  # noqa: F401

    with threadpoolctl.threadpool_limits(2):
        before = threads()
        with one_thread():
            assert threads() == {1}
        assert threads() == before


def test_margins_of_a_campaign_are_computed_in_one_thread(monkeypatch):
    from ambkit.campaigns import worker
    from ambkit.campaigns.plan import Plan
    from ambkit.campaigns.study import load

    seen = set()
    old = worker.peaks

    def spy(*given):
        blas = [each for each in threadpoolctl.threadpool_info() if each["user_api"] == "blas"]
        seen.update(each["num_threads"] for each in blas)
        return old(*given)

    monkeypatch.setattr(worker, "peaks", spy)
    with threadpoolctl.threadpool_limits(2):
        worker.compute(Plan(load("examples/machines.toml")), 0, 4)
    assert seen == {1}
