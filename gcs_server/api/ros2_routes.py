"""The ROS 2 topics of a vehicle's DDS domain."""

from __future__ import annotations

from typing import Final

from fastapi import Response

from gcs_server.api.problems import RESPONSES
from gcs_server.api.reflect import model_of
from gcs_server.api.responses import json_response
from gcs_server.api.routes import Routes
from gcs_server.api.station import StationDep, VehicleDep
from gcs_server.errors import Refused
from gcs_server.ros2.inspection import Inspection, TopicView

router = Routes(prefix="/vehicles", tags=["vehicles"], responses=RESPONSES)

Ros2TopicModel = model_of(TopicView, "Ros2Topic")
Ros2TopicsModel = model_of(Inspection, "Ros2Topics", topics=tuple[Ros2TopicModel, ...])

CHECK_PERIOD_S: Final = 0.1
MAX_START_S: Final = 4.0
"""Maximum time that a request waits for the inspector's start."""


@router.get("/{v}/ros2/topics", response_model=Ros2TopicsModel)
async def ros2_topics(vehicle: VehicleDep, station: StationDep) -> Response:
    """The ROS 2 topics of the vehicle, and the topics of its DDS domain that belong to no vehicle: type,
    publishers, rate, age, last message and confirmed layout; which vehicles are in the domain; and why topics
    are empty or setpoints do nothing (`problems`).

    The server reads ROS 2 topics only while clients request them, so the first response takes about 1.5 s.
    For continuous values subscribe to the telemetry topic `ros2_topics`. 409 `refused` if the vehicle has no
    ROS 2 link.
    """
    deadline_s = station.clock.monotonic_s() + MAX_START_S
    while (inspection := station.topic_inspectors.inspect(vehicle)) is not None:
        if inspection.state != "starting" or station.clock.monotonic_s() >= deadline_s:
            return json_response(inspection)
        await station.clock.sleep(CHECK_PERIOD_S)
    raise Refused(
        f"Vehicle {vehicle.id} has no ROS 2 link, so it has no topics to show.",
        remedy="Add a ROS 2 link (POST /links, for example ros2://0).",
    )
