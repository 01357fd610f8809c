"""When the link to a vehicle counts as lost: no message of its autopilot, or no heartbeat, for too long."""

import pytest

from gcs_server.mavlink import dialect as d
from gcs_server.mavlink.codec import Frame
from gcs_server.vehicle.state import VehicleState

AUTOPILOT, CAMERA = 1, 100


class Clock:
    now_s = 100.0

    def monotonic_s(self):
        return self.now_s

    def unix_s(self):
        return self.now_s


class VehicleStateSetup:
    """A vehicle state with a fake clock."""

    def __init__(self):
        self.clock = Clock()
        self.state = VehicleState(AUTOPILOT, self.clock)

    def take(self, message, component_id=AUTOPILOT):
        raw = message.pack(d.MAVLink(None, 1, component_id))
        self.state.take(Frame(message.get_msgId(), 1, component_id, 0, raw, self.clock.now_s))

    def lost_after_s(self, *messages, component_id=AUTOPILOT, within_s=30.0):
        """Time until the vehicle counts as lost while it sends these messages, checked every 0.5 s; None if
        it does not."""
        began_s = self.clock.now_s
        while self.clock.now_s < began_s + within_s:
            self.clock.now_s += 0.5
            if self.state.link_lost:
                return self.clock.now_s - began_s
            for message in messages:
                self.take(message, component_id)
        return None


@pytest.fixture
def setup():
    """A vehicle that has sent one heartbeat."""
    state_setup = VehicleStateSetup()
    state_setup.take(HEARTBEAT)
    return state_setup


HEARTBEAT = d.MAVLink_heartbeat_message(2, 12, 81, 0, 4, 3)
ATTITUDE = d.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0)


def test_a_vehicle_that_sends_nothing_is_lost_after_three_and_a_half_seconds(setup):
    assert setup.lost_after_s() == 4.0  # the first check after 3.5 s
    assert setup.state.reason_lost() == "no messages for 4.0 s"


def test_a_vehicle_that_sends_other_messages_is_not_lost_after_9_s_without_heartbeats(setup):
    assert setup.lost_after_s(ATTITUDE, within_s=9.0) is None


def test_a_vehicle_without_a_heartbeat_for_ten_seconds_is_lost(setup):
    assert setup.lost_after_s(ATTITUDE) == 10.5  # the first check after 10 s
    assert "no heartbeat for 10 s" in setup.state.reason_lost()


def test_messages_of_a_camera_do_not_count_as_messages_of_the_autopilot(setup):
    assert setup.lost_after_s(ATTITUDE, component_id=CAMERA) == 4.0


def test_a_lost_vehicle_returns_only_with_a_heartbeat(setup):
    setup.lost_after_s()
    setup.take(ATTITUDE)
    assert setup.state.link_lost
    setup.take(HEARTBEAT)
    assert not setup.state.link_lost
