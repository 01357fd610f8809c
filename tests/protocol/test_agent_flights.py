"""An agent asks for a flight, and a person allows it or not: what is started, and what voids a request."""

from __future__ import annotations

import json
from types import SimpleNamespace

import pytest

from gcs_server.agents.flight_requests import ANSWER_S, MAX_DRY_RUN_AGE_S
from gcs_server.api import agent_routes, command_routes, control_models, control_routes
from gcs_server.errors import InvalidRequest, NotInControl, Refused
from missions import plan as plan_document
from tests.protocol.agent_testbed import run_with_agents, with_agents, with_plans
from tests.protocol.api_calls import ANNA, BOB, journal_entries, json_of, new_station
from tests.protocol.offboard_testbed import sleep
from tests.protocol.simulated_testbed import SimulatedTestbed, until
from tests.protocol.small_plan import plan_around


class PassedDryRuns:
    """Results of dry runs without a simulation."""

    def __init__(self):
        self.bodies = {}

    def body(self, dry_run_id):
        return self.bodies[dry_run_id]


async def passed_dry_run(rig, dry_run_id="1", *, errors=0, **fields):
    """A stored plan, and a dry run of it that has just ended."""
    station = rig.station
    created = await rig.agents["flyer"].call("plans_create", name="Round", plan=rig.plan)
    head = {"kind": "waypoint_plan", "name": "Round\u202e", "plan_id": created["id"], "version": 1}
    body = {"id": dry_run_id, **head, "vehicle": "1", "vehicles": None, "monte_carlo": None, **fields}
    station.flights.dry_runs.bodies[dry_run_id] = json.dumps(body).encode()

    async def work(_report):
        return {
            "dry_run": dry_run_id,
            "finished": True,
            "errors": errors,
            "findings": errors,
            "duration_s": 60.0,
        }

    operation = station.operations.start("dry_run", work, text="", subject=dry_run_id, by=("x", "y"))
    await station.operations.wait(operation.id)
    return created


def run_on_ground(run_simulated, tmp_path, scenario):
    """Runs a test with a vehicle on the ground that is not proven to be simulated."""

    async def run(rig):
        with_plans(rig.station, tmp_path)
        rig.station.flights.dry_runs = PassedDryRuns()
        home = rig.vehicle.topic("global_position").value
        rig.plan = json.loads(plan_document.write(plan_around(home.lat_deg, home.lon_deg)))
        await scenario(rig)

    run_with_agents(run_simulated, run, flying=False, simulated=False)


async def wait(agent, until, **arguments):
    """The answer of the tool `wait`."""
    return await agent.call("wait", until=until, at_most_s=50, **arguments)


async def allow(rig, request_id, by=ANNA):
    return json_of(await agent_routes.allow_flight(request_id, rig.station, by))


@pytest.mark.flight
def test_an_agent_flies_what_a_person_has_allowed_and_stops_it_itself(run_simulated, tmp_path):
    """The whole way: plan, dry run, request, permission, flight, Hold."""

    async def scenario():
        testbed = SimulatedTestbed()
        try:
            vehicle = await testbed.wait_for_vehicle_ready_to_arm()
            station = new_station(testbed)
            station.authority.start()
            with_plans(station, tmp_path)
            flyer = with_agents(station, testbed.supervisor, simulated=False)["flyer"]
            home = vehicle.topic("home").value
            plan = json.loads(plan_document.write(plan_around(home.lat_deg, home.lon_deg)))
            created = await flyer.call("plans_create", name="there and back", plan=plan)
            operation = await flyer.call("dry_runs_start", plan_id=created["id"], vehicle="1")
            ended = await flyer.call(
                "wait", until="operation_ended", operation_id=operation["id"], at_most_s=50
            )
            assert ended["result"]["errors"] == 0
            dry_run_id = ended["result"]["dry_run"]
            assert "not proven" in await flyer.refusal("mission_upload", vehicle="1", plan_id=created["id"])
            request = await flyer.call("request_flight", dry_run_id=dry_run_id)
            assert (request["state"], request["vehicle"]) == ("waiting", "1")
            answer = await flyer.call(
                "wait", until="request_answered", request_id=request["id"], at_most_s=30
            )
            assert not answer["reached"]  # without a person nothing begins
            assert not vehicle.status.armed
            rig = SimpleNamespace(station=station)
            assert (await allow(rig, request["id"]))["state"] == "starting"
            answer = await flyer.call(
                "wait", until="request_answered", request_id=request["id"], at_most_s=50
            )
            assert answer["state"] == "started", answer
            assert station.authority.control("1").status().holder == "agent flyer"
            assert ("anna", "agents/allow_flight", None, "ok") in journal_entries(station)
            assert ("agent flyer", "mission/start", "1", "ok") in journal_entries(station)
            assert (await flyer.call("wait", until="in_air", vehicle="1", at_most_s=40))["reached"]
            assert "not proven" in await flyer.refusal(
                "goto", vehicle="1", lat_deg=home.lat_deg, lon_deg=home.lon_deg, alt_home_m=5
            )
            assert (await flyer.call("hold", vehicle="1"))["status"]["mode"] == "hold"
            await flyer.call("land", vehicle="1")
            await until(lambda: not vehicle.status.armed, 60)
        finally:
            await testbed.close()

    run_simulated(scenario)


def test_a_stale_or_failed_dry_run_or_one_of_no_vehicle_is_refused(run_simulated, tmp_path):
    async def scenario(rig):
        flyer = rig.agents["flyer"]
        await passed_dry_run(rig, "1")
        await passed_dry_run(rig, "2", errors=2)
        await passed_dry_run(rig, "3", vehicle=None)
        await passed_dry_run(rig, "4", plan_id=None, version=None)
        assert "2 errors" in await flyer.refusal("request_flight", dry_run_id="2")
        assert "not that of a stored plan" in await flyer.refusal("request_flight", dry_run_id="3")
        assert "not that of a stored plan" in await flyer.refusal("request_flight", dry_run_id="4")
        assert "nothing else" in await flyer.refusal("request_flight", dry_run_id="1", despite=["x"])
        assert "needs the scope 'fly'" in await rig.agents["pilot"].refusal("request_flight", dry_run_id="1")
        await sleep(MAX_DRY_RUN_AGE_S + 5)
        assert "ended 5 minutes ago" in await flyer.refusal("request_flight", dry_run_id="1")
        assert rig.station.agents.requests.views() == []

    run_on_ground(run_simulated, tmp_path, scenario)


def test_a_person_sees_what_is_asked_for_and_only_a_person_answers(run_simulated, tmp_path):
    async def scenario(rig):
        station, flyer = rig.station, rig.agents["flyer"]
        await passed_dry_run(rig)
        request = await flyer.call("request_flight", dry_run_id="1")
        (shown,) = json_of(await agent_routes.list_agents(station))["requests"]
        assert (shown["agent"], shown["vehicle"], shown["plan_name"]) == ("flyer", "1", "Round")
        assert (shown["duration_s"], shown["findings"], shown["state"]) == (60.0, 0, "waiting")
        (notice,) = station.agents.warnings()
        assert notice.text == "Agent flyer asks to fly 'Round' with vehicle 1."
        for by in (flyer.agent.principal, rig.agents["reader"].agent.principal):
            with pytest.raises(Refused, match="cannot allow itself"):
                await allow(rig, request["id"], by)
        with pytest.raises(InvalidRequest, match="no request '9'"):
            await allow(rig, "9")
        refused = json_of(await agent_routes.refuse_flight(request["id"], station, ANNA))
        assert (refused["state"], refused["text"]) == ("refused", "anna has refused the flight.")
        with pytest.raises(Refused, match="does not wait any more"):
            await allow(rig, request["id"])
        assert station.agents.warnings() == []

    run_on_ground(run_simulated, tmp_path, scenario)


@pytest.mark.parametrize("change", ["time", "plan", "armed", "lost", "another request"])
def test_a_request_is_void_once_what_the_person_sees_has_changed(run_simulated, tmp_path, change):
    async def scenario(rig):
        flyer = rig.agents["flyer"]
        created = await passed_dry_run(rig)
        request = await flyer.call("request_flight", dry_run_id="1")
        if change == "time":
            await sleep(ANSWER_S + 1)
        elif change == "plan":
            await rig.agents["planner"].call(
                "plans_save", plan_id=created["id"], name="x", plan=rig.plan, base_version=1
            )
        elif change == "armed":
            rig.autopilot.armed = True
            await sleep(2)
        elif change == "lost":
            rig.autopilot.send = lambda *_: None
            await sleep(5)
        else:
            await passed_dry_run(rig, "2")
            await flyer.call("request_flight", dry_run_id="2")
        with pytest.raises(Refused, match="does not wait any more"):
            await allow(rig, request["id"])
        state = rig.station.agents.requests.view(request["id"]).state
        assert state == ("expired" if change == "time" else "void")
        await sleep(2)
        assert not rig.autopilot.received_commands(300)
        assert rig.station.authority.control("1").status().holder is None

    run_on_ground(run_simulated, tmp_path, scenario)


def test_control_is_that_of_the_person_who_allows_and_not_anothers(run_simulated, tmp_path):
    async def scenario(rig):
        flyer, station = rig.agents["flyer"], rig.station
        await passed_dry_run(rig)
        request = await flyer.call("request_flight", dry_run_id="1")
        await control_routes.take("1", station, BOB, control_models.TakeControl())
        with pytest.raises(NotInControl, match="bob has control"):
            await allow(rig, request["id"])
        assert station.agents.requests.view(request["id"]).state == "waiting"
        assert (await allow(rig, request["id"], BOB))["state"] == "starting"
        status = station.authority.control("1").status()
        assert (status.holder, status.on_expiry) == ("agent flyer", "hold")

    run_on_ground(run_simulated, tmp_path, scenario)


def test_a_hold_during_the_upload_prevents_the_start(run_simulated, tmp_path):
    async def scenario(rig):
        flyer, station = rig.agents["flyer"], rig.station
        await passed_dry_run(rig)
        request = await flyer.call("request_flight", dry_run_id="1")
        await allow(rig, request["id"])
        await sleep(0.05)
        await command_routes.hold("1", station, ANNA)
        answer = await wait(flyer, "request_answered", request_id=request["id"])
        assert answer["state"] == "failed"
        assert not rig.autopilot.received_commands(300)
        assert not rig.autopilot.armed

    run_on_ground(run_simulated, tmp_path, scenario)
