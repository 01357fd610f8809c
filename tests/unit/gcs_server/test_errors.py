"""What a vehicle says of its refusal is told as it is, but no more of it than a person reads."""

from gcs_server.errors import MAX_REASON_LENGTH, MAX_REASONS, NotTogether, Rejected


def test_number_and_length_of_a_refusals_reasons_are_limited():
    said = tuple(f"reason {n} " + "x" * 1000 for n in range(5000))
    for error in (Rejected("No.", reasons=said), NotTogether("No.", vehicles=("1",), reasons=said)):
        told = error.details()["reasons"]
        assert len(told) == MAX_REASONS + 1
        assert told[-1] == f"and {5000 - MAX_REASONS} more"
        assert all(len(text) <= MAX_REASON_LENGTH + 1 for text in told)
    assert Rejected("No.", reasons=("low battery",)).details()["reasons"] == ["low battery"]
