"""Every setpoint type is supported from the request to the message."""

from typing import get_args

import pytest
from pydantic import TypeAdapter

from gcs_server.api.offboard_models import SetpointType
from gcs_server.api.setpoints import AnySetpoint
from gcs_server.streamer.frames import KINDS_TO_RESOLVE, NON_LOCAL_KINDS
from gcs_server.streamer.transport.mavlink import MAVLINK_KINDS
from gcs_server.streamer.transport.ros2 import ROS2_KINDS
from gcs_server.streamer.validation import why_not_carried
from missions.setpoints import KINDS


def test_each_setpoint_type_has_a_request_body() -> None:
    assert set(TypeAdapter(AnySetpoint).json_schema()["discriminator"]["mapping"]) == set(KINDS)


def test_responses_can_name_each_setpoint_type() -> None:
    assert set(get_args(SetpointType)) == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_a_ros_2_link_carries_every_setpoint_type(kind: str) -> None:
    assert why_not_carried(kind, "ROS 2") is None
    assert (kind in ROS2_KINDS) == (kind not in KINDS_TO_RESOLVE | NON_LOCAL_KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_each_setpoint_type_is_encoded_resolved_or_refused_with_a_reason(kind: str) -> None:
    reason = why_not_carried(kind, "MAVLink")
    assert (reason is None) == (kind in MAVLINK_KINDS | KINDS_TO_RESOLVE)
    assert reason is None or kind in reason
