"""Numbers in pictures are those that people write."""

import numpy as np
import pytest

from meshflow.view.numbers import brief, plain, rounded


@pytest.mark.parametrize(
    ("value", "shown"),
    [
        (2540.0, "2540"),
        (25412.0, "25412"),
        (0.2418, "0.242"),
        (12.345, "12.3"),
        (1.0, "1.00"),
        (-3.5, "−3.50"),
        (0.0, "0"),
        (1.02e-6, "1.02 × 10⁻⁶"),
        (4.2e-5, "42.0 × 10⁻⁶"),
        (2.5e7, "25.0 × 10⁶"),
        (float("nan"), "nan"),
    ],
)
def test_a_number_is_written_in_full_or_with_a_power_of_ten(value, shown):
    assert plain(value) == shown


@pytest.mark.parametrize(
    ("value", "shown"), [(50.0, "50"), (-0.25, "−0.25"), (-3e-5, "−30.0 × 10⁻⁶"), (1234.0, "1234"), (0.0, "0")]
)
def test_a_brief_number_ends_in_no_zero(value, shown):
    assert brief(value) == shown


def test_numbers_one_after_the_other_have_the_decimals_of_the_largest():
    assert [plain(v, 2540.0) for v in (0.0, 1.15, 63.4, 2540.0)] == ["0", "1", "63", "2540"]
    assert [plain(v, 0.24) for v in (0.0, 0.0123, 0.24)] == ["0", "0.012", "0.240"]
    assert [plain(v, 3e-8) for v in (0.0, 1.5e-9, 3e-8)] == ["0", "1.5 × 10⁻⁹", "30.0 × 10⁻⁹"]


def test_no_number_has_an_exponent():
    for value in 10.0 ** np.arange(-12, 13, 0.37):
        assert "e" not in plain(value)
        assert float(plain(value).split(" ")[0]) * 10.0 ** _power(plain(value)) == pytest.approx(value, rel=0.006)


def _power(shown):
    digits = shown.partition("× 10")[2].translate(str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789"))
    return int(digits or 0)


@pytest.mark.parametrize(
    ("value", "reported"), [(1.0, 1), (1.99, 1), (2.0, 2), (4.9, 2), (5.0, 5), (9.99, 5), (1000.0, 1000), (0.03, 0.02)]
)
def test_a_round_number_is_the_next_of_one_two_five_below(value, reported):
    assert rounded(value) == pytest.approx(reported)
