"""The team of threads: as many as were asked for, from wherever, and always the same bits."""

import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time

import joblib
import numpy as np
import pytest

import meshflow
from meshflow.estimate.request import Request
from meshflow.kernels.arrays import copied
from meshflow.kernels.gate import Stopped
from meshflow.kernels.interruption import interruptible
from meshflow.kernels.library import default_threads, using_threads
from meshflow.kernels.parameters import Stop
from meshflow.kernels.trials import trial_census, trial_endless, trial_sum
from meshflow.results.run import states
from meshflow.surfaces.mesh import Mesh
from meshflow.synthetic.shapes import sphere


def summed(seed, threads=3, inner=1):
    """In a module of its own name, so that processes find it."""
    x = np.random.default_rng(seed).random(30000, np.float32)
    total = np.zeros(1, np.float32)
    trial_sum(x, total, 1000, threads, inner)
    return total[0].tobytes()


@pytest.mark.parametrize("threads", [1, 2, 3, 4])
def test_threads_are_counted_exactly_with_the_caller(threads):
    who = np.full(4 * threads, -1, np.int32)
    trial_census(who, threads)
    assert set(who) == set(range(threads))


def test_no_more_threads_come_than_there_are_parts():
    who = np.full(2, -1, np.int32)
    trial_census(who, 16)
    assert set(who) == {0, 1}


@pytest.mark.parametrize("parts", [1, 2, 7, 1000])
def test_every_part_is_done_once(parts):
    for threads in (1, 2, 5):
        total = np.zeros(1)
        assert trial_sum(np.ones(parts), total, 1, threads, 1) == parts
        assert total[0] == parts


def test_results_do_not_depend_on_threads_nor_on_threads_within_threads():
    assert len({summed(5, threads, inner) for threads in (1, 2, 3, 8) for inner in (1, 2)}) == 1


def test_several_callers_at_once_get_the_same_bits():
    expected = [summed(seed, 1) for seed in range(8)]
    found: dict[int, set[bytes]] = {seed: set() for seed in range(8)}

    def call(seed):
        for turn in range(40):
            found[seed].add(summed(seed, 1 + turn % 4, 1 + turn % 2))

    callers = [threading.Thread(target=call, args=(seed,)) for seed in range(8)]
    for caller in callers:
        caller.start()
    for caller in callers:
        caller.join(120)
    assert not any(caller.is_alive() for caller in callers)
    assert found == {seed: {expected[seed]} for seed in range(8)}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_child_of_a_fork_makes_a_team_of_its_own():
    expected = [summed(seed) for seed in range(6)]
    for _ in range(3):
        with multiprocessing.get_context("fork").Pool(2) as pool:
            assert pool.map_async(summed, range(6)).get(60) == expected
    assert [summed(seed) for seed in range(6)] == expected


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_a_child_can_be_forked_while_other_threads_are_at_work():
    stop = Stop()
    worker = threading.Thread(target=lambda: pytest.raises(Stopped, trial_endless, 10**9, stop, 3))
    worker.start()
    try:
        for seed in range(5):
            with multiprocessing.get_context("fork").Pool(1) as pool:
                assert pool.apply_async(summed, (seed,)).get(60) == summed(seed)
    finally:
        stop.set()
        worker.join(60)
    assert not worker.is_alive()


def test_a_spawned_process_gets_the_same_bits():
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        assert pool.apply_async(summed, (3,)).get(120) == summed(3)


@pytest.mark.parametrize("backend", ["loky", "threading"])
def test_workers_of_joblib_give_the_same_bits_of_grids_and_of_meshes(backend):
    noise = np.random.default_rng(2)
    terrain = 5 * np.sin(np.add.outer(np.arange(40.0), np.arange(50.0)) / 9) + noise.normal(size=(40, 50))
    points, faces = sphere(2).points, sphere(2).faces
    ball = points + 0.02 * noise.normal(size=points.shape), faces
    jobs = [(terrain, "quick"), (ball, "quick"), (terrain, "quick")]
    here = [meshflow.smooth(data, method=method) for data, method in jobs]
    workers = joblib.Parallel(n_jobs=2, backend=backend)
    there = workers(joblib.delayed(meshflow.smooth)(data, method=method) for data, method in jobs)
    for one, other in zip(here, there, strict=True):
        np.testing.assert_array_equal(one[0], other[0])


@pytest.mark.parametrize("threads", [1, 3])
def test_another_thread_stops_a_kernel(threads):
    stop = Stop()
    timer = threading.Timer(0.1, stop.set)
    timer.start()
    begin = time.perf_counter()
    with pytest.raises(Stopped, match="trial_endless"):
        trial_endless(10**9, stop, threads)
    assert time.perf_counter() - begin < 5
    assert stop.is_set()
    trial_endless(3, Stop(), threads)


def test_a_call_beside_the_caller_gives_its_result_or_its_own_error():
    assert interruptible(lambda flag: flag.is_set()) is False

    def late(flag):
        raise TimeoutError("its own")

    with pytest.raises(TimeoutError, match="its own"):
        interruptible(late)


def test_an_exception_of_the_caller_stops_the_kernel_beside_him():
    def interrupt(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        with pytest.raises(KeyboardInterrupt):
            interruptible(lambda flag: trial_endless(10**9, flag, 2))
    finally:
        signal.signal(signal.SIGALRM, before)


def test_a_team_that_has_nothing_to_do_sleeps():
    """No time of a processor passes while nobody calls."""
    trial_census(np.zeros(8, np.int32), 4)
    time.sleep(0.05)
    begin = time.process_time()
    time.sleep(0.5)
    assert time.process_time() - begin < 0.1


def test_the_interpreter_is_free_while_a_kernel_works():
    stop, turns = Stop(), 0
    worker = threading.Thread(target=lambda: pytest.raises(Stopped, trial_endless, 10**9, stop, 1))
    worker.start()
    begin = time.perf_counter()
    while time.perf_counter() - begin < 0.2:
        turns += 1
    stop.set()
    worker.join(60)
    assert turns > 1000


def test_copies_are_copies_in_any_number_of_threads():
    source = np.random.default_rng(0).random((1 << 18) + 5)
    for threads in (1, 2, 4, None):
        target = np.zeros_like(source)
        copied(source, target, threads)
        np.testing.assert_array_equal(source, target)


def test_threads_by_default_are_those_of_the_process_or_of_the_environment(monkeypatch):
    monkeypatch.delenv("MESHFLOW_NUM_THREADS", raising=False)
    if hasattr(os, "sched_getaffinity"):
        assert default_threads() == len(os.sched_getaffinity(0))
    monkeypatch.setenv("MESHFLOW_NUM_THREADS", "3")
    assert default_threads() == 3
    who = np.zeros(12, np.int32)
    trial_census(who)
    assert set(who) == {0, 1, 2}
    for wrong in ("0", "-1", "many", "1.5"):
        monkeypatch.setenv("MESHFLOW_NUM_THREADS", wrong)
        with pytest.raises(
            ValueError, match=f"MESHFLOW_NUM_THREADS='{wrong}': a number of threads expected, 1 or more"
        ):
            default_threads()


def census():
    """By how many threads a kernel is run whose caller names none."""
    who = np.zeros(12, np.int32)
    trial_census(who)
    return len(set(who))


def test_threads_are_used_where_they_were_asked_for_and_nowhere_else():
    other = []
    with using_threads(4):
        with using_threads(None):
            assert census() == 4
        with using_threads(3):
            caller = threading.Thread(target=lambda: other.append(census()))
            caller.start()
            caller.join()
            assert census() == 3
        assert census() == 4
    assert other == [default_threads()] == [census()]


@pytest.mark.parametrize("stepper", ["explicit", "semi-implicit"])
def test_the_threads_of_a_run_reach_the_loops_over_a_mesh(stepper):
    ball, seen = sphere(3), []
    method, compute = meshflow.CurvatureFlow(), meshflow.Compute(threads=3, stepper=stepper)
    mesh = Mesh(ball.points, ball.faces)
    meshflow.smooth(mesh, method=method, time=0.01, compute=compute, progress=lambda *_: seen.append(census()))
    assert set(seen) == {3}
    request = Request.of(method=method, time=0.01, compute=compute)
    assert {census() for _ in states(mesh, request, 3)} == {default_threads()}


def test_a_process_ends_while_its_team_sleeps_or_works():
    code = (
        "import threading, numpy as np\n"
        "from meshflow.kernels.trials import trial_census, trial_endless\n"
        "trial_census(np.zeros(4, np.int32), 4)\n"
        "threading.Thread(target=trial_endless, args=(10**9, None, 2), daemon=True).start()\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)
