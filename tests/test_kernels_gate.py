"""What comes to a kernel is as it was declared, or is refused before anything is read."""

import ctypes
import time
from typing import Annotated

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meshflow.kernels import arguments
from meshflow.kernels.arrays import copied
from meshflow.kernels.gate import kernel
from meshflow.kernels.library import library
from meshflow.kernels.parameters import Array, Struct, compare_layout, integer, read, write
from meshflow.kernels.trials import (
    TrialOptions,
    trial_failed,
    trial_gathered,
    trial_options,
    trial_over,
    trial_rows,
)

DTYPES = (np.float32, np.float64)


def rows(dtype=np.float64):
    return np.arange(12, dtype=dtype).reshape(3, 4), np.zeros((3, 4), dtype)


@pytest.mark.parametrize("dtype", DTYPES)
def test_a_kernel_is_run_for_the_number_type_of_its_arrays(dtype):
    source, target = rows(dtype)
    assert trial_rows(source, target, None, 2.0, 1) == 12
    np.testing.assert_array_equal(target, source * 2 + 1)


def test_arguments_may_be_named_and_left_out():
    source, target = rows()
    trial_rows(source, shift=3, target=target)
    np.testing.assert_array_equal(target, source + 3)
    with pytest.raises(TypeError, match="missing a required argument: 'target'"):
        trial_rows(source)  # pyright: ignore[reportCallIssue]
    with pytest.raises(TypeError, match="unexpected keyword argument 'shift_by'"):
        trial_rows(source, target, shift_by=3)  # pyright: ignore[reportCallIssue]
    with pytest.raises(TypeError, match="multiple values"):
        trial_rows(source, target, source=source)  # pyright: ignore[reportCallIssue]
    with pytest.raises(TypeError, match="too many"):
        trial_rows(source, target, None, 1.0, 1, 1)  # pyright: ignore[reportCallIssue]


REFUSED = [
    (TypeError, "source: an array .h, w. of float32 or float64 expected, got list", ([[1.0]], None)),
    (TypeError, "source: .* expected, got NoneType", (None, None)),
    (TypeError, "expected, got int64", (np.zeros((3, 4), int), None)),
    (TypeError, "expected, got >f8", (np.zeros((3, 4), ">f8"), None)),
    (TypeError, "expected, got complex128", (np.zeros((3, 4), complex), None)),
    (TypeError, "expected, got object", (np.zeros((3, 4), object), None)),
    (TypeError, "target: float64 expected, as the arrays before it, got float32", (None, np.zeros((3, 4), np.float32))),
    (ValueError, r"got the shape \(12,\)", (np.zeros(12), None)),
    (ValueError, r"target: .* h = 3, w = 4, got the shape \(4, 3\)", (None, np.zeros((4, 3)))),
    (ValueError, "contiguous.*np.ascontiguousarray", (np.zeros((4, 3)).T, None)),
    (ValueError, "contiguous.*np.ascontiguousarray", (np.zeros((3, 8))[:, ::2], None)),
    (ValueError, "contiguous.*np.ascontiguousarray", (np.zeros((3, 4))[:, ::-1], None)),
    (ValueError, "contiguous.*np.ascontiguousarray", (np.zeros((3, 4))[::-1], None)),
    (ValueError, "contiguous.*np.ascontiguousarray", (np.broadcast_to(np.zeros(4), (3, 4)), None)),
    (ValueError, "address is no multiple of 8", (np.zeros(97, np.uint8)[1:].view(np.float64).reshape(3, 4), None)),
]


@pytest.mark.parametrize(("error", "words", "arrays"), REFUSED)
def test_an_array_of_another_kind_is_refused_and_what_came_is_said(error, words, arrays):
    sound = rows()
    source, target = (sound[i] if a is None and "NoneType" not in words else a for i, a in enumerate(arrays))
    with pytest.raises(error, match=words):
        trial_rows(source, target)  # pyright: ignore[reportArgumentType]
    trial_rows(*sound)


def test_what_is_written_must_be_writeable_and_in_memory_of_its_own():
    source, target = rows()
    target.flags.writeable = False
    with pytest.raises(ValueError, match="target: it is written, but the array is read-only"):
        trial_rows(source, target)
    whole = np.zeros((6, 4))
    for target in (whole[2:5], whole[:3], whole[1:4]):
        with pytest.raises(ValueError, match="target is written and shares memory with source"):
            trial_rows(whole[:3], target)
    trial_rows(whole[:3], whole[3:])
    trial_rows(source, np.zeros((3, 4)))
    with pytest.raises(ValueError, match="target is written and shares memory with mask"):
        trial_rows(source, whole[:3], whole[:1].view(bool)[0, :12].reshape(3, 4))


def test_an_array_may_be_written_over_only_where_that_is_declared_and_only_itself():
    x = np.arange(6.0)
    trial_over(x, x)
    np.testing.assert_array_equal(x, -np.arange(6.0))
    with pytest.raises(ValueError, match="shares memory"):
        trial_over(x[:5], x[1:])
    with pytest.raises(ValueError, match="shares memory"):
        copied(x, x)


@pytest.mark.parametrize("dtype", DTYPES)
def test_rows_that_stand_apart_are_read_and_written_where_they_are(dtype):
    source, target = np.arange(80, dtype=dtype).reshape(8, 10), np.zeros((9, 7), dtype)
    expected = target.copy()
    expected[1:8:2, 2:7] = source[2:6, 1:6] * dtype(3)
    trial_rows(source[2:6, 1:6], target[1:8:2, 2:7], factor=3.0)
    np.testing.assert_array_equal(target, expected)


def test_rows_that_overlap_may_not_be_written():
    twice = np.lib.stride_tricks.as_strided(np.zeros(10), (3, 4), (16, 8))
    with pytest.raises(ValueError, match="target: rows that are contiguous and stand one after the other"):
        trial_rows(rows()[0], twice)
    trial_rows(twice, rows()[1])


def test_what_is_optional_may_be_none_and_masks_are_of_bool():
    source, target = rows()
    mask = source % 2 == 0
    trial_rows(source, target, mask)
    np.testing.assert_array_equal(target, np.where(mask, source, 0))
    with pytest.raises(TypeError, match="mask: an array .h, w. of bool expected, got uint8"):
        trial_rows(source, target, mask.astype(np.uint8))
    with pytest.raises(ValueError, match=r"mask: .* h = 3, w = 4, got the shape \(3, 3\)"):
        trial_rows(source, target, mask[:, :3].copy())


def test_lengths_are_compared_across_arrays_and_indices_with_what_they_point_to():
    begin, index = np.array([0, 2, 2, 3]), np.array([0, 4, 1], np.int32)
    source, target = np.arange(5.0), np.zeros(3)
    assert trial_gathered(begin, index, source, target) == 8
    np.testing.assert_array_equal(target, [4, 0, 1])
    with pytest.raises(ValueError, match=r"target: an array \(m,\) .* m = 3, got the shape \(4,\)"):
        trial_gathered(begin, index, source, np.zeros(4))
    with pytest.raises(ValueError, match=r"begin: an array \(m\+1,\)"):
        trial_gathered(begin[:0], index, source, target[:0])
    for wrong in (-1, 5, 2**31 - 1):
        bad = index.copy()
        bad[1] = wrong
        with pytest.raises(ValueError, match=f"index: indices of 0 or more and below n = 5 expected, got .*{wrong}"):
            trial_gathered(begin, bad, source, target)
    with pytest.raises(ValueError, match=r"begin: indices of 0 or more and below k\+1 = 4 expected, got 0 to 4"):
        trial_gathered(np.array([0, 2, 2, 4]), index, source, target)


def test_nothing_is_a_size_too():
    copied(np.zeros(0), np.zeros(0))
    assert trial_rows(np.zeros((0, 4)), np.zeros((0, 4))) == 0
    assert trial_gathered(np.zeros(1, int), np.zeros(0, np.int32), np.zeros(0), np.zeros(0)) == 0


def test_numbers_are_of_their_kind():
    source, target = rows()
    trial_rows(source, target, None, np.float32(2), np.int8(1))
    np.testing.assert_array_equal(target, source * 2 + 1)
    with pytest.raises(TypeError, match="factor: a number expected, got 'much'"):
        trial_rows(source, target, None, "much")  # pyright: ignore[reportArgumentType]
    with pytest.raises(TypeError, match="shift: an integer expected, got 1.5"):
        trial_rows(source, target, None, 1.0, 1.5)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="shift: an integer of 64 bits expected"):
        trial_rows(source, target, None, 1.0, 2**63)
    with pytest.raises(ValueError, match="threads: 1 to 1024 threads expected, got 0"):
        copied(source.ravel(), target.ravel(), 0)
    with pytest.raises(TypeError, match="threads: a number of threads expected, or None, got 1.0"):
        copied(source.ravel(), target.ravel(), 1.0)  # pyright: ignore[reportArgumentType]


def test_options_arrive_as_they_were_set():
    seen = np.zeros(6)
    assert trial_options(TrialOptions(1.5, -3, 200, (7.0, 8.0)), 6, seen) == 6
    np.testing.assert_array_equal(seen, [1.5, -3, 200, 7, 8, 0])
    with pytest.raises(TypeError, match="options: TrialOptions expected, got dict"):
        trial_options({}, 6, seen)  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match=r"seen: .* count = 7, got the shape \(6,\)"):
        trial_options(TrialOptions(), 7, seen)
    with pytest.raises(ValueError, match="count: a size of 0 or more"):
        trial_options(TrialOptions(), -1, seen)


@pytest.mark.parametrize(
    "fields",
    [
        TrialOptions._fields_[:-1],
        [TrialOptions._fields_[i] for i in (0, 2, 1, 3)],
        [("factor", ctypes.c_float), *TrialOptions._fields_[1:]],
        [("factors", ctypes.c_double), *TrialOptions._fields_[1:]],
    ],
)
def test_a_struct_of_another_layout_is_refused_when_it_is_first_used(fields):
    other = type("TrialOptions", (Struct,), {"_fields_": fields})
    with pytest.raises(TypeError, match="TrialOptions: declared with .* compiled with"):
        compare_layout(other, library())


def test_a_declaration_that_is_not_what_was_compiled_is_refused_on_the_first_call():
    def wrong_order(target: Annotated[Array, write("T", "n")], source: Annotated[Array, read("T", "n")]) -> None:
        """Target and source interchanged."""

    def shorter(source: Annotated[Array, read("T", "n")], target: Annotated[Array, write("T", "n")]) -> None:
        """Without threads."""

    for function in (wrong_order, shorter):
        function.__name__ = "copied"
        with pytest.raises(TypeError, match="copied_f64: declared as .* compiled as vqrdwdvi"):
            kernel(function)(np.zeros(2), np.zeros(2))

    @kernel
    def nowhere(source: Annotated[Array, read("T", "n")]) -> None:
        """Not compiled."""

    with pytest.raises(AttributeError, match="nowhere_f64: the library has no such kernel"):
        nowhere(np.zeros(2))


def test_a_declaration_without_meaning_is_refused_when_it_is_made():
    with pytest.raises(TypeError, match="cannot be handed to a kernel"):
        read(complex, "n")
    with pytest.raises(TypeError, match="indices are int32 or int64"):
        read(np.uint8, "n", below="n")
    with pytest.raises(ValueError, match="the length of an axis"):
        read("T", "2*n")
    with pytest.raises(TypeError, match="first: no array has the size m"):

        @kernel
        def pointing(first: Annotated[Array, read(np.int32, "n", below="m")]) -> None:
            """Below a size that is nowhere."""

    with pytest.raises(TypeError, match="n: Annotated"):

        @kernel
        def plain(n: int, m: Annotated[int, integer]) -> None:
            """One parameter is not annotated."""


def test_a_failure_within_is_an_error_outside():
    assert trial_failed(7, 100) == 7
    with pytest.raises(MemoryError, match="trial_failed"):
        trial_failed(0, 2**62)
    with pytest.raises(RuntimeError, match="the code -9"):
        trial_failed(-9, 0)


def test_the_address_of_an_array_is_where_numpy_says():
    for array in (np.zeros(3), np.zeros((4, 5), np.float32)[1:, 2:], np.zeros(0), np.zeros(7, np.uint8)[::-2]):
        assert arguments.address(array) == array.ctypes.data
    assert arguments.address is arguments._read_from_object


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_whatever_comes_is_refused_or_done_and_nothing_beyond_its_end_is_touched(data):
    """Arrays of any type, shape, order and offset, cut out of one buffer whose rest must stay as it is."""
    buffer = np.frombuffer(bytearray(b"\x2a" * 4096), np.uint8)

    def any_array():
        dtype = np.dtype(data.draw(st.sampled_from(["f4", "f8", ">f8", "f2", "i4", "i8", "?", "u1"])))
        shape = tuple(data.draw(st.lists(st.integers(0, 4), min_size=1, max_size=3)))
        strides = tuple(
            data.draw(st.integers(-3, 12)) * data.draw(st.sampled_from([dtype.itemsize] * 3 + [1])) for _ in shape
        )
        if data.draw(st.booleans()):
            strides = tuple(int(np.prod(shape[i + 1 :])) * dtype.itemsize for i in range(len(shape)))
        offset = 1024 + data.draw(st.sampled_from([0, 0, 512, 1024])) + data.draw(st.sampled_from([0, 0, 8, 4, 1]))
        array = np.ndarray(shape, dtype, buffer, offset, strides)
        array.flags.writeable = data.draw(st.sampled_from([True, True, False]))
        return array

    arrays = [any_array() for _ in range(2)]
    if data.draw(st.booleans()):
        arrays[1] = np.ndarray(arrays[0].shape, arrays[0].dtype, buffer, 3072)
    before, reached = buffer.copy(), np.zeros(len(buffer), bool)
    start = buffer.ctypes.data
    for index in np.ndindex(arrays[1].shape):
        at = arrays[1][tuple([slice(i, i + 1) for i in index])].ctypes.data - start
        reached[at : at + arrays[1].itemsize] = True
    try:
        with np.errstate(all="ignore"):
            trial_rows(*arrays, factor=data.draw(st.floats(-2, 2)))
    except (TypeError, ValueError):
        assert (buffer == before).all()
    else:
        assert arrays[0].shape == arrays[1].shape
        assert (buffer == before)[~reached].all()


def test_a_call_costs_microseconds():
    source, target = np.zeros(4), np.zeros(4)
    copied(source, target, 1)
    least = np.inf
    for _ in range(50):
        begin = time.perf_counter()
        for _ in range(100):
            copied(source, target, 1)
        least = min(least, (time.perf_counter() - begin) / 100)
    assert least < 20e-6, f"{least * 1e6:.1f} microseconds"
