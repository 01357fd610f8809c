"""Dry runs for a vehicle by the server's routes: the server uses what it knows about the vehicle, and sends
nothing to the vehicle."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest

from gcs_server.api import control_routes, dry_run_models, dry_run_routes, vehicle_model_routes
from gcs_server.errors import InvalidRequest
from missions.dry_run.setup import release_name, simulated_release
from missions.what_if.identified import Identified, VehicleModel
from tests.protocol.api_calls import ANNA, BOB, FORCED_CONTROL_REQUEST, json_of, run_with_routes
from tests.protocol.command_numbers import REQUEST_MESSAGE, RUN_PREARM_CHECKS, SET_MESSAGE_INTERVAL
from tests.protocol.offboard_testbed import sleep

AT_20_M = {"value_m": 20, "reference": "home"}
POSITION = {"lat_deg": 47.397742, "lon_deg": 8.545594, "altitude": AT_20_M}
PLAN = {"items": [{"kind": "takeoff", **POSITION}, {"kind": "return_home"}]}

MESSAGE_REQUESTS = (RUN_PREARM_CHECKS, SET_MESSAGE_INTERVAL, REQUEST_MESSAGE)


class DryRunRecorder:
    """Records the requests for dry runs, and starts no process."""

    def __init__(self) -> None:
        self.requests = []

    def next_id(self, client_key):
        return "1"

    async def run(self, dry_run_id, plan, request, run_info, report, client_key):
        self.requests.append((request, run_info))
        report("Half.", 0.5)
        return {"dry_run": dry_run_id}


async def request_dry_run(rig, client=ANNA, **fields):
    rig.station.flights.dry_runs = DryRunRecorder()
    body = dry_run_models.DryRunRequest.model_validate({"plan": PLAN, "vehicle": "1", **fields})
    operation = json_of(await dry_run_routes.start_dry_run(body, rig.station, client))
    await rig.station.operations.wait(operation["id"])
    return rig.station.flights.dry_runs.requests[-1]


def commands_with_effect(autopilot):
    """Received commands without the server's requests for messages, which change nothing."""
    types = ("COMMAND_LONG", "COMMAND_INT", "SET_MODE", "PARAM_SET")
    received = [
        m
        for m in autopilot.received_messages
        if m.get_type() in types or m.get_type().startswith(("MISSION_", "SET_"))
    ]
    return [m for m in received if getattr(m, "command", 0) not in MESSAGE_REQUESTS]


def test_a_dry_run_uses_the_vehicles_known_data_and_lists_what_is_unknown(run_simulated):
    async def scenario(rig):
        request, run_info = await request_dry_run(rig)
        aircraft = request["aircraft"]
        position = rig.vehicle.topic("global_position").value
        assert aircraft["home"] == {
            "lat_deg": position.lat_deg, "lon_deg": position.lon_deg, "alt_amsl_m": position.alt_amsl_m
        }  # fmt: skip
        assert aircraft["yaw_ned_rad"] == rig.vehicle.topic("attitude").value.yaw_ned_rad
        assert aircraft["parameters"] == {}
        assert "The parameters of vehicle 1 have not been read" in run_info["assumed"][0]
        assert aircraft["px4"] == release_name(simulated_release(rig.vehicle.identity.software.release))
        assert run_info["vehicle"] == "1"
        assert set(request["origin"]) == {"lat_deg", "lon_deg", "alt_amsl_m"}
        json.dumps(request, allow_nan=False)

    run_with_routes(run_simulated, scenario, flying=False)


class FlightsOfOneLog:
    """A logbook with one flight, whose log says a thrust and no drag."""

    def __init__(self, uid=None, vehicle="1") -> None:
        best = SimpleNamespace(uid=uid, vehicle=vehicle)
        files = {"f": SimpleNamespace(path=Path("own.ulg"))}
        self._flight = SimpleNamespace(id="f-0", name=None, best=best, files=files)

    async def flight(self, _flight_id):
        return self._flight

    async def identify(self, _flight, mass_kg):
        unknown = Identified(0.0, 1.0)
        body = {"SIH_MASS": mass_kg, "SIH_T_MAX": 9.0}
        return msgspec.json.encode(
            VehicleModel(Identified(24.0, 0.2), unknown, False, False, None, mass_kg, 36.0, None, body, [])
        )


def test_dry_runs_fly_with_the_kept_model_and_say_so_until_it_is_forgotten(run_simulated):
    async def scenario(rig):
        rig.station.logbook = FlightsOfOneLog()
        body = vehicle_model_routes.ModelToKeep(flight="f-0", mass_kg=1.5)
        kept = json_of(await vehicle_model_routes.keep_model("1", body, rig.station, ANNA))["model"]
        shown = json_of(await vehicle_model_routes.show_model(rig.station, rig.vehicle))["model"]
        assert kept == shown
        assert (kept["flight"], kept["log"], kept["drag_per_s"]) == ("f-0", "own.ulg", None)
        request, run_info = await request_dry_run(rig)
        assert request["aircraft"]["body"] == {"SIH_MASS": 1.5, "SIH_T_MAX": 9.0}
        (said,) = [text for text in run_info["assumed"] if "identified in a flight" in text]
        assert said.startswith("The body of vehicle 1 is the one identified in a flight: thrust by mass 24.0")
        await vehicle_model_routes.forget_model("1", rig.station, ANNA)
        request, run_info = await request_dry_run(rig)
        assert "body" not in request["aircraft"]
        assert not any("identified" in text for text in run_info["assumed"])
        assert commands_with_effect(rig.autopilot) == []

    run_with_routes(run_simulated, scenario, flying=False)


@pytest.mark.parametrize("logged", [{"vehicle": "2"}, {"uid": "0" * 36, "vehicle": "1"}])
def test_the_model_of_another_vehicle_is_not_kept(run_simulated, logged):
    async def scenario(rig):
        rig.vehicle._identity = replace(rig.vehicle.identity, uid="1" * 36)
        rig.station.logbook = FlightsOfOneLog(**logged)
        body = vehicle_model_routes.ModelToKeep(flight="f-0")
        with pytest.raises(InvalidRequest, match="another vehicle"):
            await vehicle_model_routes.keep_model("1", body, rig.station, ANNA)
        assert rig.station.flights.models.find(rig.vehicle.identity) is None

    run_with_routes(run_simulated, scenario, flying=False)


@pytest.mark.parametrize(
    ("firmware", "px4", "assumption"),
    [
        (None, "1.17", "The release of PX4 of vehicle 1 is not known: v1.17 is simulated."),
        ("1.15.4", "1.16", "PX4 v1.15 of vehicle 1 cannot be simulated: v1.16 is."),
        ("1.17.0", "1.17", None),
    ],
)
def test_a_dry_run_flies_as_the_vehicles_own_release_of_px4(run_simulated, firmware, px4, assumption):
    async def scenario(rig):
        rig.vehicle._identity = replace(rig.vehicle.identity, firmware=firmware)
        request, run_info = await request_dry_run(rig)
        assert request["aircraft"]["px4"] == px4
        assert [text for text in run_info["assumed"] if "PX4 v1" in text or "release" in text] == (
            [] if assumption is None else [assumption]
        )

    run_with_routes(run_simulated, scenario, flying=False)


def test_a_dry_run_of_a_vehicle_in_flight_starts_at_its_home(run_simulated):
    async def scenario(rig):
        request, run_info = await request_dry_run(rig)
        home = rig.vehicle.topic("home").value
        assert request["aircraft"]["home"]["lat_deg"] == home.lat_deg
        assert any("starts on the ground at its home" in text for text in run_info["assumed"])

    run_with_routes(run_simulated, scenario)


def test_a_dry_run_sends_nothing_to_the_vehicle_and_needs_no_control(run_simulated):
    async def scenario(rig):
        await control_routes.take("1", rig.station, BOB, FORCED_CONTROL_REQUEST)
        await sleep(1.0)
        count_before = len(commands_with_effect(rig.autopilot))
        await request_dry_run(rig, ANNA, flights=50)
        await sleep(1.0)
        assert [str(m) for m in commands_with_effect(rig.autopilot)[count_before:]] == []
        assert rig.station.authority.control("1").status().holder_key == BOB.key

    run_with_routes(run_simulated, scenario)
