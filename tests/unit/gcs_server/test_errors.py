"""The reasons of a refusal are limited in number and length."""

from gcs_server.errors import MAX_REASON_LENGTH, MAX_REASONS, NotTogether, Rejected


def test_number_and_length_of_a_refusals_reasons_are_limited():
    reasons = tuple(f"reason {n} " + "x" * 1000 for n in range(5000))
    for error in (Rejected("No.", reasons=reasons), NotTogether("No.", vehicles=("1",), reasons=reasons)):
        reason_texts = error.details()["reasons"]
        assert len(reason_texts) == MAX_REASONS + 1
        assert reason_texts[-1] == f"and {5000 - MAX_REASONS} more"
        assert all(len(text) <= MAX_REASON_LENGTH + 1 for text in reason_texts)
    assert Rejected("No.", reasons=("low battery",)).details()["reasons"] == ["low battery"]
