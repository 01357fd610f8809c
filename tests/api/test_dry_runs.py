"""Dry runs over HTTP: a request with a plan, or with the id of a stored plan, starts an operation."""

import contextlib
import json
import math
import sys

import pytest

from gcs_server.errors import GcsError
from gcs_server.flights.dry_runs import merged_assumptions
from gcs_server.plans import dry_runs
from tests.support.api_client import api_client

AT_20_M = {"value_m": 20, "reference": "home"}
HOME = {"lat_deg": 47.4, "lon_deg": 8.5, "alt_amsl_m": 488}
PLAN = {
    "planned_home": HOME,
    "items": [
        {"kind": "takeoff", "lat_deg": 47.4, "lon_deg": 8.5, "altitude": AT_20_M},
        {"kind": "return_home"},
    ],
}
MISSION = {
    "format": "offboard-gcs-mission",
    "name": "Hop",
    "steps": [{"step": "take_off", "height_m": 5}, {"step": "land"}],
}
TWO_ROLES = {
    "format": "offboard-gcs-mission",
    "name": "Show",
    "home": HOME,
    "roles": {
        "lead": {"start_ned_m": [0, 0, 0], "steps": MISSION["steps"]},
        "left": {"start_ned_m": [0, 10, 0], "steps": MISSION["steps"]},
    },
}
THREE_ROLES = {**TWO_ROLES, "roles": {**TWO_ROLES["roles"], "right": TWO_ROLES["roles"]["lead"]}}
ROLES_WITHOUT_POSITIONS = {
    **TWO_ROLES,
    "roles": {role: {"steps": MISSION["steps"]} for role in TWO_ROLES["roles"]},
}
MAST = {"name": "mast", "north_m": 5, "east_m": 0, "length_m": 1, "width_m": 1, "height_m": 30}
WORKER = """
import json, sys
request = json.loads(sys.stdin.readline())
print(json.dumps({"text": "half", "progress": 0.5}), flush=True)
names = ("finished", "duration_s", "battery_end_share", "fence_distance_m", "obstacle_distance_m")
nominal = {**dict.fromkeys(names, 1), "findings": [{"severity": "error"}], "request": request}
result = {"nominal": nominal, "monte_carlo": None, "group": None}
response = json.dumps({"id": request["id"], **request["details"], **result})
summary = {**dict.fromkeys(names, 1), "errors": 1, "findings": 1}
print(json.dumps({"result": summary, "body_bytes": len(response)}) + "\\n" + response, end="", flush=True)
"""
"""A stand-in for the worker process that returns the request it received."""


@pytest.fixture
def client(tmp_path, monkeypatch):
    monkeypatch.setattr(dry_runs, "COMMAND", (sys.executable, "-c", WORKER))
    with api_client(tmp_path, path="/api/v1/") as client:
        yield client


def run_to_end(client, body):
    """Starts a dry run and returns its finished operation."""
    started = client.post("dry_runs", json=body)
    assert started.status_code == 202, started.text
    operation = started.json()
    assert started.headers["location"] == f"/api/v1/operations/{operation['id']}"
    with contextlib.suppress(GcsError):
        client.portal.call(client.app.state.station.operations.wait, operation["id"])
    return client.get(f"operations/{operation['id']}").json()


def test_a_plan_in_the_body_is_flown_with_the_given_conditions(client):
    request = {
        "plan": PLAN,
        "conditions": {"wind_ned_m_s": [0, 4, 0], "gusts_m_s": 1},
        "flights": 20,
        "spread": {"wind_m_s": 2},
        "obstacles": [MAST],
        "endurance_s": 900,
        "seed": 7,
    }
    operation = run_to_end(client, request)
    assert operation["state"] == "succeeded"
    assert operation["result"]["errors"] == 1
    view = client.get(f"dry_runs/{operation['result']['dry_run']}").json()
    worker_request = view["nominal"]["request"]
    assert (view["kind"], view["vehicle"], view["plan_id"]) == ("waypoint_plan", None, None)
    assert view["assumed"] == ["No vehicle is named: PX4's defaults and a full battery are used."]
    assert worker_request["aircraft"] == {"home": HOME, "endurance_s": 900, "battery_reserve": 0.2}
    assert worker_request["conditions"]["wind_ned_m_s"] == [0, 4, 0]
    assert (worker_request["flights"], worker_request["seed"], worker_request["spread"]["wind_m_s"]) == (
        20,
        7,
        2,
    )
    assert worker_request["obstacles"][0]["base_alt_home_m"] == 0
    assert json.loads(worker_request["plan"])["items"][0]["kind"] == "takeoff"


def test_a_stored_plan_and_an_offboard_mission_are_flown(client):
    stored = client.post("plans", json={"name": "Tower", "plan": PLAN}).json()
    view = client.get(f"dry_runs/{run_to_end(client, {'plan_id': stored['id']})['result']['dry_run']}").json()
    assert (view["plan_id"], view["version"], view["name"]) == (stored["id"], 1, "Tower")
    operation = run_to_end(client, {"plan": MISSION})
    view = client.get(f"dry_runs/{operation['result']['dry_run']}").json()
    assert view["kind"] == "offboard_mission"


def test_the_roles_of_a_mission_start_at_their_planned_positions(client):
    operation = run_to_end(client, {"plan": TWO_ROLES, "flights": 20})
    view = client.get(f"dry_runs/{operation['result']['dry_run']}").json()
    assert (view["vehicles"], view["nominal"]["request"]["flights"]) == (None, 20)
    roles = view["nominal"]["request"]["roles"]
    assert list(roles) == ["lead", "left"]
    lead, left = (roles[role]["aircraft"]["home"] for role in ("lead", "left"))
    assert lead["lat_deg"] == pytest.approx(HOME["lat_deg"])
    assert left["lat_deg"] == pytest.approx(HOME["lat_deg"], abs=1e-7)
    metres_per_degree_east = 111_320 * math.cos(math.radians(HOME["lat_deg"]))
    assert (left["lon_deg"] - HOME["lon_deg"]) * metres_per_degree_east == pytest.approx(10.0, abs=0.1)
    assert view["assumed"] == ["No vehicle is named: PX4's defaults and a full battery are used."]


def test_an_assumption_about_several_roles_is_reported_once_with_their_names():
    unknown_parameters, flying = "The parameters of the vehicle are not known.", "The vehicle is flying."
    battery = "PX4's defaults and a full battery are used."
    assumed = {"lead": [battery, unknown_parameters], "left": [battery, unknown_parameters, flying]}
    assert merged_assumptions(assumed) == [battery, f"lead and left: {unknown_parameters}", f"left: {flying}"]


@pytest.mark.parametrize(
    ("body", "text"),
    [
        ({}, "plan_id and plan"),
        ({"plan": {"items": PLAN["items"]}}, "plan.planned_home"),
        ({"plan": PLAN, "flights": 201}, "flights"),
        ({"plan": PLAN, "conditions": {"wind_ned_m_s": [0, 50, 0]}}, "wind_ned_m_s"),
        ({"plan": PLAN, "conditions": {"mass_scale": True}}, "mass_scale"),
        ({"plan": PLAN, "version": 2}, "version"),
        ({"plan": PLAN, "endurance_s": 0}, "endurance_s"),
        ({"plan": PLAN, "vehicles": {"lead": "1", "left": "2"}}, "vehicles"),
        ({"plan": PLAN, "vehicle": "1", "vehicles": {"lead": "1"}}, "vehicles"),
        ({"plan": TWO_ROLES, "vehicles": {"lead": "1"}}, "role 'left' has no vehicle"),
        ({"plan": TWO_ROLES, "vehicle": "1"}, "name a vehicle for each role"),
        ({"plan": THREE_ROLES, "flights": 134}, "134 flights of 3 vehicles are too many"),
        ({"plan": ROLES_WITHOUT_POSITIONS}, "The start positions are not known"),
    ],
)
def test_invalid_dry_runs_are_refused_and_the_error_names_the_cause(client, body, text):
    refused = client.post("dry_runs", json=body)
    assert refused.status_code == 422
    assert text in refused.text


def test_an_unknown_vehicle_plan_or_dry_run_gets_status_404(client):
    assert client.post("dry_runs", json={"plan": PLAN, "vehicle": "9"}).json()["code"] == "unknown_vehicle"
    assert client.post("dry_runs", json={"plan_id": "none"}).json()["code"] == "unknown_plan"
    assert client.get("dry_runs/77").json()["code"] == "unknown_dry_run"
