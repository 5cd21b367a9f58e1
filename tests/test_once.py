"""Results for the same arrays are computed once while nobody writes to them. meshflow.geometry.once."""

import numpy as np

from meshflow.geometry import once as module
from meshflow.geometry.connectivity import connect
from meshflow.geometry.once import once, unwritten


def counted():
    calls = []

    @once
    def total(numbers, parts=(), more=0):
        calls.append(numbers)
        return sum(map(float, numbers)) + sum(float(part.sum()) for part in parts) + more

    return total, calls


def test_the_same_arrays_are_computed_once_and_equal_ones_anew():
    total, calls = counted()
    one, part = np.arange(3.0), np.ones(2)
    with unwritten():
        assert total(one, (part,), more=1) == total(one, (part,), more=1) == 6.0
        assert len(calls) == 1
        assert total(one.copy(), (part,), more=1) == total(one, (part.copy(),), more=1) == 6.0
        assert len(calls) == 3
        assert total(one, (part,), more=2) == 7.0


def test_arrays_may_be_written_to_before_and_after():
    total, calls = counted()
    one = np.arange(3.0)
    assert total(one) == 3.0
    with unwritten():
        assert total(one) == 3.0
    one[0] = 5.0
    assert total(one) == 8.0
    with unwritten():
        assert total(one) == 8.0
    assert len(calls) == 4


def test_an_array_in_the_place_of_one_that_is_gone_is_not_taken_for_it():
    total, _ = counted()
    with unwritten():
        for number in range(100):
            assert total(np.full(4, float(number))) == 4.0 * number


def test_only_the_last_results_are_kept():
    total, calls = counted()
    arrays = [np.full(1, float(i)) for i in range(module.KEPT + 1)]
    with unwritten():
        for array in arrays:
            total(array)
        total(arrays[-1])
        assert len(calls) == len(arrays)
        total(arrays[0])
        assert len(calls) == len(arrays) + 1


def test_connectivity_of_the_same_triangles_is_one_object_in_a_run():
    faces = np.array([[0, 1, 2], [1, 3, 2]])
    assert connect((faces,), 4) is not connect((faces,), 4)
    with unwritten():
        assert connect((faces,), 4) is connect((faces,), 4)
        assert connect((faces,), 5).size == 5
