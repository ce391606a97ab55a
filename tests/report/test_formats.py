"""Numbers, probabilities and times as text."""

import pytest

from dldsim.report.formats import duration, number, probability


@pytest.mark.parametrize(
    ("value", "digits", "shown"),
    [
        (0.0, 3, "0"),
        (1234567, 3, "1 234 567"),
        (0.98765, 3, "0.988"),
        (9.996, 3, "10.0"),
        (12345.6, 3, "12 346"),
        (-2.5, 2, "−2.5"),
        (3.2e-5, 2, "3.2 × 10⁻⁵"),
        (None, 3, "–"),
        (float("nan"), 3, "–"),
        (True, 3, "yes"),
        (2.5e7, 3, "2.50 × 10⁷"),
    ],
)
def test_number_format(value, digits, shown):
    assert number(value, digits).replace("\u202f", " ") == shown


def test_probability_and_duration_format():
    assert [probability(p) for p in (0.25, 4.4e-12, 0.0, None)] == [
        "0.250",
        "4.4 × 10⁻¹²",
        "< 10⁻³⁰⁰",
        "–",
    ]
    assert [duration(s) for s in (47.0, 930.0, 12000.0)] == ["47 s", "16 min", "3.33 h"]
