"""Dry runs for a vehicle by the server's routes: which of its data they use, and that they send it
nothing."""

import json

from gcs_server.api import control_routes, dry_run_models, dry_run_routes
from tests.protocol.api_calls import ANNA, BOB, FORCE, view, with_routes
from tests.protocol.offboard_world import seconds

AT_20_M = {"value_m": 20, "reference": "home"}
PLACE = {"lat_deg": 47.397742, "lon_deg": 8.545594, "altitude": AT_20_M}
PLAN = {"items": [{"kind": "takeoff", **PLACE}, {"kind": "return_home"}]}

MESSAGE_REQUESTS = (401, 511, 512)
"""MAV_CMD_RUN_PREARM_CHECKS, MAV_CMD_SET_MESSAGE_INTERVAL, MAV_CMD_REQUEST_MESSAGE."""


class DryRuns:
    """Replaces the processes; returns the request."""

    def __init__(self) -> None:
        self.requests = []

    def next_id(self):
        return "1"

    async def run(self, dry_run_id, request, about, report):
        self.requests.append((request, about))
        report("Half.", 0.5)
        return {"dry_run": dry_run_id}


async def request_by(at, by=ANNA, **more):
    at.station.dry_runs = DryRuns()
    body = dry_run_models.DryRunRequest.model_validate({"plan": PLAN, "vehicle": "1", **more})
    operation = view(await dry_run_routes.start_dry_run(body, at.station, by))
    await at.station.operations.wait(operation["id"])
    return at.station.dry_runs.requests[-1]


def commands(autopilot):
    """Commands that would change something; the server's requests for messages do not count."""
    kinds = ("COMMAND_LONG", "COMMAND_INT", "SET_MODE", "PARAM_SET")
    received = [
        m
        for m in autopilot.received
        if m.get_type() in kinds or m.get_type().startswith(("MISSION_", "SET_"))
    ]
    return [m for m in received if getattr(m, "command", 0) not in MESSAGE_REQUESTS]


def test_a_dry_run_uses_the_vehicles_known_data_and_lists_what_is_unknown(jump):
    async def scenario(at):
        request, about = await request_by(at)
        aircraft = request["aircraft"]
        here = at.vehicle.topic("global_position").value
        assert aircraft["home"] == {
            "lat_deg": here.lat_deg, "lon_deg": here.lon_deg, "alt_amsl_m": here.alt_amsl_m
        }  # fmt: skip
        assert aircraft["yaw_ned_rad"] == at.vehicle.topic("attitude").value.yaw_ned_rad
        assert aircraft["parameters"] == {}
        assert "The parameters of vehicle 1 have not been read" in about["assumed"][0]
        assert about["vehicle"] == "1"
        assert set(request["origin"]) == {"lat_deg", "lon_deg", "alt_amsl_m"}
        json.dumps(request, allow_nan=False)

    with_routes(jump, scenario, flying=False)


def test_a_dry_run_of_a_vehicle_in_flight_starts_at_its_home(jump):
    async def scenario(at):
        request, about = await request_by(at)
        home = at.vehicle.topic("home").value
        assert request["aircraft"]["home"]["lat_deg"] == home.lat_deg
        assert any("starts on the ground at its home" in text for text in about["assumed"])

    with_routes(jump, scenario)


def test_a_dry_run_sends_nothing_to_the_vehicle_and_needs_no_control(jump):
    async def scenario(at):
        await control_routes.take("1", at.station, BOB, FORCE)
        await seconds(1.0)
        before = len(commands(at.autopilot))
        await request_by(at, ANNA, flights=50)
        await seconds(1.0)
        assert [str(m) for m in commands(at.autopilot)[before:]] == []
        assert at.station.authority.control("1").status().holder_key == BOB.key

    with_routes(jump, scenario)
