"""A setpoint in a request becomes the value that is flown, or an error that names the field."""

import math

import pytest
from fastapi.exceptions import RequestValidationError
from pydantic import ValidationError

from gcs_server.api.problems import validation_errors
from gcs_server.api.setpoints import SetpointRequest
from missions import setpoints as s

EXAMPLES = {
    kind.type: kind.__pydantic_config__["json_schema_extra"]["examples"][0]
    for kind in s.KINDS.values()
    if kind is not s.Attitude
}


@pytest.mark.parametrize("kind", EXAMPLES)
def test_each_example_becomes_a_value_of_its_class(kind):
    setpoint = SetpointRequest.model_validate({"setpoint": EXAMPLES[kind]}).setpoint
    assert type(setpoint) is s.KINDS[kind]
    for name, value in EXAMPLES[kind].items():
        if name != "points":
            assert getattr(setpoint, name) == (tuple(value) if isinstance(value, list) else value)


def test_an_attitude_is_given_as_angles_or_as_a_quaternion():
    angles = {"type": "attitude", "roll_rad": 0, "pitch_rad": 0, "yaw_ned_rad": math.pi, "thrust": 0.5}
    for attitude in (angles, {"type": "attitude", "q_ned_frd": [0, 0, 0, 1], "thrust": 0.5}):
        setpoint = SetpointRequest.model_validate({"setpoint": attitude}).setpoint
        assert isinstance(setpoint, s.Attitude)
        assert setpoint.q_ned_frd == pytest.approx((0, 0, 0, 1), abs=1e-9)


POSITION = {"type": "position", "position_ned_m": [0, 0, -10]}
POINTS = [{"t_s": t_s, "position_ned_m": [0, 0, -10]} for t_s in (0, 5)]


@pytest.mark.parametrize(
    ("setpoint", "field", "message"),
    [
        ({**POSITION, "speed": 1}, "setpoint.speed", "Extra inputs are not permitted"),
        ({**POSITION, "yaw_ned_rad": True}, "setpoint.yaw_ned_rad", "valid number"),
        ({**POSITION, "yaw_ned_rad": 7}, "setpoint.yaw_ned_rad", "less than or equal to 6.28"),
        ({**POSITION, "yaw_ned_rad": 0, "yaw_rate_ned_rad_s": 0}, "setpoint", "not both"),
        ({**POSITION, "type_mask": 3}, "setpoint", "type_mask: The ignore bits follow"),
        ({"type": "position"}, "setpoint.position_ned_m", "required"),
        ({"type": "hover"}, "setpoint", "'hover'"),
        ({"position_ned_m": [0, 0, 0]}, "setpoint", "'type'"),
        ({"type": "position_global", "lat_deg": 1, "lon_deg": 2}, "setpoint", "exactly one of alt"),
        ({"type": "actuators"}, "setpoint", "motors or servos"),
        ({"type": "follow", "vehicle": "2", "offset_frd_m": [1, 0, 0]}, "setpoint", "at least 2 m"),
        ({"type": "attitude", "thrust": 0.5}, "setpoint", "give q_ned_frd"),
        ({"type": "path", "points": POINTS[1:] * 2}, "setpoint", "points.0.t_s must be 0"),
        (
            {"type": "path", "points": [{**POINTS[0], "t_s": "0"}, POINTS[1]]},
            "setpoint.points.0.t_s",
            "number",
        ),
        ({"type": "path", "points": [{**POINTS[0], "t_s": "0"}] * 5000}, "setpoint.points.0.t_s", "valid"),
        ({"type": "path", "points": [{**POINTS[0], "x": 0}, POINTS[1]]}, "setpoint.points.0.x", "Extra"),
    ],
)
def test_an_invalid_setpoint_causes_an_error_that_names_the_field(setpoint, field, message):
    with pytest.raises(ValidationError) as error:
        SetpointRequest.model_validate({"setpoint": setpoint})
    (problem,) = validation_errors(RequestValidationError(error.value.errors(include_url=False)))
    assert problem["field"] == field
    assert message in problem["message"]


def test_the_journal_has_the_setpoint_without_the_points_of_a_path():
    body = SetpointRequest.model_validate({"setpoint": {"type": "path", "points": POINTS}, "valid_for_s": 2})
    assert body.arguments() == {
        "setpoint": {"type": "path", "points": "2 points"},
        "valid_for_s": 2.0,
        "on_expiry": {"action": "hold", "hold_for_s": 5.0},
    }
