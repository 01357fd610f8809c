"""PX4's reasons not to fly a mission, in words."""

import struct

import pytest

from gcs_server.vehicle.px4.events import describe, has_description, rejection_reason


@pytest.mark.parametrize(
    ("event_id", "arguments", "reason"),
    [
        (22901736, b"", "it starts with a landing, and the vehicle is on the ground"),
        (25552931, struct.pack("<HH", 3, 5000), "item 3 has the command 5000, which the vehicle cannot fly"),
        (28985965, struct.pack("<f", 1.8), "the take-off is too low: it must be more than 1.8 m above home"),
        (19608877, struct.pack("<h", 4), "item 4 is outside the geofence"),
        (
            30155728,
            struct.pack("<ff", 0.01, 0.05),
            "a gate is 0.01 m from its waypoint; it needs at least 0.05 m",
        ),
    ],
)
def test_a_reason_is_a_clause_with_the_values_of_the_event(event_id, arguments, reason):
    assert rejection_reason(event_id, arguments.ljust(40, b"\0")) == reason
    text, _, _ = describe(event_id, arguments.ljust(40, b"\0"))
    assert text == f"The vehicle will not fly its mission: {reason}"
    assert has_description(event_id, None)


def test_another_event_is_no_reason():
    assert rejection_reason(26266355, bytes(40)) is None
