"""Each call of a program sends a setpoint that the API accepts, of its own type."""

import inspect

import pytest

from gcs_server.api.setpoints import StartRequest
from gcs_server.client import setpoints
from gcs_server.client.offboard import SetpointCalls
from missions.setpoints import Follow, Path

CALLS = {
    "position_ned": ((1, 2, -3), {"yaw_ned_rad": 0.5, "yaw_rate_ned_rad_s": None}, "position"),
    "position_global": ((47.0, 8.0), {"alt_home_m": 10}, "position_global"),
    "position_body": ((1, 0, 0), {"yaw_offset_rad": 0.1}, "position_body"),
    "velocity_ned": ((1, 0, 0), {"yaw_rate_ned_rad_s": 0.1}, "velocity"),
    "velocity_body": ((1, 0, 0), {}, "velocity_body"),
    "acceleration_ned": ((1, 0, 0), {"yaw_ned_rad": 1}, "acceleration"),
    "trajectory": (
        (),
        {"position_ned_m": (1, 2, None), "velocity_ned_m_s": [0, 0, 1], "yaw_ned_rad": 0},
        "trajectory",
    ),
    "attitude": ((0.5,), {"roll_rad": 0.1, "pitch_rad": 0, "yaw_ned_rad": 1}, "attitude"),
    "rates": ((0, 0, 0.1, 0.5), {}, "rates"),
    "thrust_torque": (((0, 0, -0.5), (0, 0, 0)), {}, "thrust_torque"),
    "actuators": (([0.1, None],), {"servos": (0.5,)}, "actuators"),
    "path": (([(0, (0, 0, -5)), (4, (4, 0, -5))],), {}, "path"),
    "follow": (("2",), {"offset_ned_m": (0, 5, 0), "yaw": "face"}, "follow"),
    "follow_device": (
        (47.0, 8.0),
        {"accuracy_m": 5, "offset_ne_m": (0, 15), "alt_home_m": 12, "velocity_ne_m_s": None},
        "follow_device",
    ),
}


class Recorder(SetpointCalls[setpoints.Body]):
    def send(self, body):
        return body


@pytest.mark.parametrize("name", CALLS)
def test_a_call_sends_a_setpoint_of_its_type_that_the_api_accepts(name):
    args, options, kind = CALLS[name]
    body = getattr(Recorder(), name)(*args, **options)
    assert body == getattr(setpoints, name)(*args, **options)
    assert None not in body.values()
    assert StartRequest.model_validate({"setpoint": body}).setpoint.type == kind


def test_every_type_has_a_call_and_a_wrong_argument_is_refused():
    assert {kind for _, _, kind in CALLS.values()} >= {Follow.type, Path.type}
    documented = [name for name in CALLS if inspect.getdoc(getattr(Recorder, name))]
    assert documented == list(CALLS)
    with pytest.raises(TypeError):
        Recorder().rates(0, 0)
