"""Work of single runs on the threads of a diagnosis."""

import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from wsp_env.diagnosis.arrow import Arrow, ByRun, Eliminated
from wsp_env.diagnosis.side_by_side import on_threads, side_by_side


def _slowly(number: int) -> tuple[int, str]:
    time.sleep(0.02 / (1 + number))  # the first ends last
    return number, threading.current_thread().name


def test_results_keep_their_order_on_the_threads_of_the_pool() -> None:
    with ThreadPoolExecutor(2, "other") as pool, on_threads(pool):
        found = side_by_side(_slowly, range(5))
    assert [number for number, _ in found] == [0, 1, 2, 3, 4]
    assert {name[:5] for _, name in found} == {"other"}


def test_work_inside_a_task_of_the_pool_stays_in_its_thread() -> None:
    """With as many tasks as threads, tasks that waited for others would wait for ever."""
    with ThreadPoolExecutor(2, "other") as pool, on_threads(pool):
        each = list(pool.map(lambda _: [name for _, name in side_by_side(_slowly, range(3))], range(2)))
    assert [len(set(names)) for names in each] == [1, 1]


def test_a_single_task_stays_in_its_thread_and_hands_its_own_work_on() -> None:
    with ThreadPoolExecutor(2, "other") as pool, on_threads(pool):
        ((thread, inside),) = side_by_side(lambda n: (threading.current_thread().name, side_by_side(_slowly, range(n))), [3])
        assert side_by_side(_slowly, []) == []
    assert thread == threading.current_thread().name
    assert {name[:5] for _, name in inside} == {"other"}


def test_afterwards_it_works_in_the_calling_thread() -> None:
    with ThreadPoolExecutor(1, "other") as pool, on_threads(pool):
        pass
    assert side_by_side(_slowly, range(1)) == [(0, threading.current_thread().name)]


def test_threads_change_no_bit_of_a_block_arrow_matrix() -> None:
    rng = np.random.default_rng(3)
    run = np.repeat(np.arange(4), 30)
    own = [rng.normal(size=(120, 5)) * (run == one)[:, None] for one in range(4)]
    columns = np.column_stack([*own, rng.normal(size=(120, 6))])

    def solve() -> Arrow:
        stored = ByRun.of(columns, run)
        order = stored.order(1)
        return Eliminated(Arrow.of(stored.parts(order), len(order.common)), 5).inverse()

    alone = solve()
    with ThreadPoolExecutor(2) as pool, on_threads(pool):
        together = solve()
    for one, other in zip((*alone.own, *alone.cross), (*together.own, *together.cross), strict=True):
        assert np.array_equal(one, other)
    assert np.array_equal(alone.common, together.common)
