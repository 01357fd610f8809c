"""The marks of the replay's time bar (modes, armed times, messages) for flights of a real PX4."""

import pytest

from gcs_server.replay.index import make_index
from gcs_server.replay.marks import make_marks
from gcs_server.replay.records import open_log


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("offboard-api.tlog.gz", ["Armed", "Take-off detected", "Failsafe active", "Disarmed"]),
        ("failsafe-battery.tlog", ["Armed", "Takeoff detected", "Low battery", "Critical battery"]),
    ],
)
def test_marks_have_the_texts_in_order_and_no_findings_of_health_reports(reference_data, name, expected):
    path = reference_data / "px4" / "tlogs" / name
    with open_log(path) as file:
        index = make_index(file)
    (vehicle,) = make_marks(path, index)
    texts = [message.text for message in vehicle.messages]
    assert [text for text in dict.fromkeys(texts) if text in expected] == expected
    # The findings of health reports would be many more texts.
    assert len(texts) < 20
    assert vehicle.armed
    assert vehicle.modes[-1].end_unix_s == index.end_us / 1e6
