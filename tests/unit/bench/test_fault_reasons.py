"""Each recorded fault that the simulator does not reproduce within the limits has a documented reason."""

from __future__ import annotations

import pytest

from tests.bench import fault_recordings
from tests.bench.faults import DOCUMENT, HEADER, Comparison, OutOfLimits, reasons, rows

ROW = "| gps_lost_hold | 24 | 0 and 1 | 72 | 0 and 0 | text | chance |"
LATE_EVENT = OutOfLimits("xy_valid=0", 7.0, (5.0, 5.1))


def document(*lines: str) -> str:
    return "\n".join(("text", "", HEADER, "|---" * 7 + "|", *lines, "", "| another | table |"))


def test_the_documentation_gives_every_row_a_reason_and_names_recorded_faults():
    documented_reasons = reasons(DOCUMENT.read_text(encoding="utf-8"))
    assert documented_reasons
    if fault_recordings.FAULTS.is_dir():
        assert set(documented_reasons) <= set(fault_recordings.names())


@pytest.mark.parametrize("lines", [(ROW, ROW), (ROW.replace("chance", " "),)])
def test_a_row_without_a_reason_or_a_second_row_of_a_fault_is_an_error(lines):
    with pytest.raises(ValueError, match="gps_lost_hold"):
        reasons(document(*lines))


def test_the_table_marks_faults_without_a_reason_and_reasons_without_a_fault():
    documented_reasons = reasons(document(ROW))
    comparison_outside_limits = Comparison("baro_stuck_hold", 3, 9, (LATE_EVENT,), ())
    comparison_within_limits = Comparison("gps_lost_hold", 24, 72, (), ())
    text = "\n".join(rows([comparison_outside_limits, comparison_within_limits], documented_reasons))
    assert "| baro_stuck_hold | 3 | 1 | 9 | 0 | xy_valid=0: 7.00, PX4 5.00 and 5.10 | NO REASON" in text
    assert "STALE: gps_lost_hold" in text
    late_comparison = Comparison("gps_lost_hold", 24, 72, (LATE_EVENT,), ())
    text = "\n".join(rows([late_comparison], documented_reasons))
    assert "chance |" in text
    assert "STALE" not in text
