"""Every command that moves a vehicle × every interruption × every await point: after an interruption was
answered, nothing is sent for the earlier command that arms, selects a mode to fly in or begins a stream."""

import asyncio
import functools
import random
from contextlib import suppress
from types import SimpleNamespace

import pytest

from gcs_server.api import (
    authorized,
    autotune_routes,
    command_routes,
    control_models,
    control_routes,
    group_routes,
    hold_routes,
    mission_models,
    mission_routes,
    models,
    offboard_mission_models,
    offboard_mission_routes,
    offboard_routes,
    operation_routes,
)
from gcs_server.control.commands import ALL
from gcs_server.errors import GcsError
from tests.interleaving import run_interleaved
from tests.protocol.api_calls import (
    ANNA,
    BOB,
    FORCED_CONTROL_REQUEST,
    MISSION_MODE,
    START_REQUEST,
    InlinePlanWork,
    new_station,
)
from tests.protocol.autotune_vehicle import AUTOTUNE, Px4Autotune
from tests.protocol.command_numbers import (
    ARM_DISARM,
    DO_CHANGE_SPEED,
    DO_ORBIT,
    DO_REPOSITION,
    DO_SET_MODE,
    TAKEOFF_COMMAND,
)
from tests.protocol.fake_autopilot import HOLD_MODE, LAND_MODE, POSITION_MODE, RTL_MODE, TAKEOFF_MODE
from tests.protocol.group_testbed import position_setpoint, start_request
from tests.protocol.mission_autopilot import MissionAutopilot
from tests.protocol.offboard_testbed import OffboardAutopilot, OffboardTestbed, sleep
from vehicle_sim.mavlink import generated_dialect as sim

LAT, LON = 47.397742, 8.545594
ALTITUDE = {"value_m": 10, "reference": "home"}
PLAN = {
    "items": [
        {"kind": "takeoff", "lat_deg": LAT, "lon_deg": LON, "altitude": ALTITUDE},
        {"kind": "waypoint", "lat_deg": LAT + 1e-4, "lon_deg": LON, "altitude": ALTITUDE},
        {"kind": "return_home"},
    ]
}
MISSION = {
    "format": "offboard-gcs-mission",
    "version": 1,
    "name": "Hover",
    "steps": [{"step": "take_off", "height_m": 5}, {"step": "land"}],
}
JOINT_MISSION = {
    "format": "offboard-gcs-mission",
    "version": 1,
    "name": "Pair",
    "roles": {role: {"steps": MISSION["steps"]} for role in "ab"},
}
SETTLE_S = 8.0
"""Time after the command and the interruption; longer than any command is sent again [s]."""
STOPPING_MODES = (HOLD_MODE, LAND_MODE, RTL_MODE, POSITION_MODE)


class Autopilot(MissionAutopilot, OffboardAutopilot):
    """A scripted vehicle that has a mission service and flies Offboard."""


class SlowPlanWork(InlinePlanWork):
    """Each task takes some time, as in another process."""

    async def run(self, task, arguments, **options):
        await sleep(0.2)
        answer = await super().run(task, arguments, **options)
        await sleep(0.2)
        return answer


class Caller:
    """The HTTP connection of a request."""

    def __init__(self):
        self.closed, self.end_is_seen = asyncio.Event(), False

    async def receive(self):
        await self.closed.wait()
        self.end_is_seen = True
        return {"type": "http.disconnect"}


async def upload(rig):
    body = mission_models.UploadRequest.model_validate({"plan": PLAN, "wait": True})
    await mission_routes.upload("1", body, rig.station, ANNA)
    await sleep(1.5)


async def in_interrupted_mission(rig):
    await upload(rig)
    rig.autopilots["1"].set_hovering()
    await sleep(2.5)


# Each command: whether the vehicles fly, what is done before, and the call.
COMMANDS = {
    "arm": (False, None, lambda rig: command_routes.arm("1", rig.station, ANNA)),
    "takeoff": (
        False,
        None,
        lambda rig: command_routes.takeoff("1", models.TakeoffRequest(alt_home_m=10), rig.station, ANNA),
    ),
    "goto": (
        True,
        None,
        lambda rig: command_routes.goto(
            "1",
            models.GotoRequest(lat_deg=LAT + 1e-4, lon_deg=LON, alt_home_m=20),
            rig.station,
            ANNA,
        ),
    ),
    "altitude": (
        True,
        None,
        lambda rig: command_routes.altitude("1", models.AltitudeRequest(alt_home_m=20), rig.station, ANNA),
    ),
    "heading": (
        True,
        None,
        lambda rig: command_routes.heading("1", models.HeadingRequest(yaw_ned_deg=90), rig.station, ANNA),
    ),
    "speed": (
        True,
        None,
        lambda rig: command_routes.speed("1", models.SpeedRequest(speed_m_s=3), rig.station, ANNA),
    ),
    "orbit": (
        True,
        None,
        lambda rig: command_routes.orbit(
            "1",
            models.OrbitRequest(lat_deg=LAT, lon_deg=LON, alt_home_m=20, radius_m=20, speed_m_s=3),
            rig.station,
            ANNA,
        ),
    ),
    "autotune/start": (
        True,
        None,
        lambda rig: autotune_routes.start_autotune(
            "1", rig.station, ANNA, autotune_routes.AutotuneRequest(despite=["autotune_low"])
        ),
    ),
    "mode": (
        True,
        in_interrupted_mission,
        lambda rig: command_routes.mode("1", models.ModeRequest(mode="mission"), rig.station, ANNA),
    ),
    "mission/start": (False, upload, lambda rig: mission_routes.start("1", rig.station, ANNA)),
    "mission/resume": (
        True,
        in_interrupted_mission,
        lambda rig: mission_routes.resume("1", rig.station, ANNA),
    ),
    "offboard/start": (
        True,
        None,
        lambda rig: offboard_routes.start("1", START_REQUEST, rig.station, ANNA),
    ),
    "offboard_mission/start": (
        False,
        None,
        lambda rig: offboard_mission_routes.start(
            "1",
            offboard_mission_models.StartMission.model_validate({"mission": MISSION}),
            rig.station,
            ANNA,
        ),
    ),
    "offboard_missions/start": (
        False,
        None,
        lambda rig: offboard_mission_routes.start_group(
            offboard_mission_models.StartGroupMission.model_validate(
                {"mission": JOINT_MISSION, "vehicles": {"a": "1", "b": "2"}}
            ),
            rig.station,
            ANNA,
        ),
    ),
    "group/start": (
        True,
        None,
        lambda rig: group_routes.start(
            start_request({v: position_setpoint(down_m=-6.0) for v in ("1", "2")}), rig.station, ANNA
        ),
    ),
}
POINTS = 16
"""Number of await points at which the long test interrupts a command; the first step accepts it."""
WITHOUT_A_CASE = {"offboard_mission/resume", "offboard_mission/skip", "offboard_mission/go_on"}
"""These commands act in one step: they have no await point before the mission commands."""


async def cancel_operation(rig):
    running = [each for each in rig.station.operations.all() if each.state == "running"]
    assert running
    for each in running:
        await operation_routes.cancel_operation(each.id, rig.station, ANNA)


async def close_connection(rig):
    rig.caller.closed.set()
    for _ in range(5000):
        if rig.caller.end_is_seen or not is_running(rig):
            return
        await asyncio.sleep(0.001)


def is_running(rig):
    return any(each.state == "running" for each in rig.station.operations.all())


async def remove_vehicle(rig):
    rig.station.fleet._remove(rig.station.fleet.get("1"), "the test removed it")


INTERRUPTIONS = {
    "hold": lambda rig: command_routes.hold("1", rig.station, BOB),
    "hold all": lambda rig: hold_routes.hold_several(
        hold_routes.HoldRequest(vehicles=("1", "2")), rig.station, BOB
    ),
    "land now": lambda rig: command_routes.land_now(
        "1", control_models.LandNowRequest(confirm="vehicle 1 lands now"), rig.station, BOB
    ),
    "kill": lambda rig: command_routes.kill(
        "1", models.KillRequest(confirm="motors stop, vehicle 1 falls"), rig.station, BOB
    ),
    "disarm": lambda rig: command_routes.disarm("1", rig.station, ANNA),
    "land": lambda rig: command_routes.land("1", rig.station, ANNA),
    "rtl": lambda rig: command_routes.rtl("1", rig.station, ANNA),
    "mode position": lambda rig: command_routes.mode(
        "1", models.ModeRequest(mode="position"), rig.station, ANNA
    ),
    "offboard/stop": lambda rig: offboard_routes.stop("1", rig.station, ANNA),
    "mission abort": lambda rig: offboard_mission_routes.abort("1", rig.station, ANNA),
    "mission pause": lambda rig: offboard_mission_routes.pause("1", rig.station, ANNA),
    "release": lambda rig: control_routes.release("1", rig.station, ANNA),
    "leave": lambda rig: control_routes.leave(rig.station, ANNA),
    "forced take-over": lambda rig: control_routes.take("1", rig.station, BOB, FORCED_CONTROL_REQUEST),
    "operation cancelled": cancel_operation,
    "connection closed": close_connection,
    "vehicle removed": remove_vehicle,
}
ENDS_A_FLIGHT = {
    *("hold", "hold all", "land now", "kill", "disarm", "land", "rtl", "mode position"),
    *("mission abort", "mission pause"),
}
"""Interruptions that also end a flight which has begun; the others end a command that is not answered."""


def is_moving(message):
    """Whether a frame to the vehicle arms, selects a mode to fly in, or gives a target."""
    command = getattr(message, "command", None)
    if command == ARM_DISARM:
        return message.param1 == 1.0
    if command == DO_SET_MODE:
        return (int(message.param2) << 16 | int(message.param3) << 24) not in STOPPING_MODES
    return command in (TAKEOFF_COMMAND, DO_REPOSITION, DO_ORBIT, DO_CHANGE_SPEED, AUTOTUNE)


def record_streams(streams, sent):
    """Records the begin of each setpoint stream."""
    for name in ("begin", "watch"):
        method = getattr(streams, name)

        def recorded(*args, name=name, method=method):
            sent.append(name)
            return method(*args)

        setattr(streams, name, recorded)


def add_autopilot(testbed, number, seed, sent):
    """Adds a vehicle, and records the frames that it receives and that move it."""
    link = testbed.link(f"link{number}")
    autopilot = Autopilot(link, peer=f"peer{number}", system=number, uid=number, seed=seed)
    Px4Autotune(autopilot)
    link.autopilots[autopilot.peer] = autopilot
    receive, parser = autopilot.receive, sim.MAVLink(None)

    def received(data):
        sent.extend(m for m in parser.parse_buffer(data) or [] if is_moving(m))
        receive(data)

    autopilot.receive = received
    autopilot.position[1] += (number - 1) * 4e-4
    autopilot.home = tuple(autopilot.position)
    return autopilot


def problem_of(rig, interruption, outcome, sent, marks):
    """What was wrong after the interruption; None: nothing."""
    autopilot = rig.autopilots["1"]
    ends_disarmed = not autopilot.armed and interruption != "vehicle removed"
    if ends_disarmed and autopilot.mode in (TAKEOFF_MODE, MISSION_MODE):
        return "the disarmed vehicle stays in a mode in which the next arming starts a flight"
    failed = isinstance(outcome, BaseException)
    if failed and not isinstance(outcome, GcsError):
        return f"the caller got {outcome!r}"
    if marks.answered is None or (marks.was_answered and interruption not in ENDS_A_FLIGHT):
        return None
    if not failed and not marks.was_answered and marks.answered == 0:
        return "nothing was sent, but the command was answered as done"
    late = sent[marks.answered :]
    return f"sent after the answer: {[str(each)[:90] for each in late]}" if late else None


def run_case(command, interruption, step, seed):
    """Runs a command and, directly before one of its steps, an interruption; returns the number of steps."""
    flying, prepare, call = COMMANDS[command]
    result = SimpleNamespace(steps=0, problem=None)

    async def scenario(loop):
        testbed = OffboardTestbed()
        testbed.may_have_faults = True
        sent = []
        record_streams(testbed.streamer._streams, sent)
        autopilots = {str(number): add_autopilot(testbed, number, seed, sent) for number in (1, 2)}
        if flying:
            for autopilot in autopilots.values():
                autopilot.set_hovering()
        try:
            for vehicle_id in autopilots:
                await testbed.wait_for_vehicle(vehicle_id)
            await sleep(1.5)
            rig = SimpleNamespace(station=new_station(testbed), autopilots=autopilots, caller=Caller())
            rig.station.flights.plan_work = SlowPlanWork()
            rig.station.flights.missions.start()
            for vehicle in testbed.fleet.all():
                rig.station.flights.missions.attach(vehicle)
            if prepare is not None:
                await prepare(rig)
            await control_routes.take("1", rig.station, ANNA)
            await run_interrupted(loop, rig, sent)
        finally:
            for autopilot in autopilots.values():
                autopilot.alive = False
            with suppress(Exception):
                await testbed.close()

    async def run_interrupted(loop, rig, sent):
        async def commanded():
            authorized._caller.set(rig.caller)
            return await call(rig)

        answers = []
        marks = SimpleNamespace(answered=None, was_answered=False)
        del sent[:]

        async def interrupt():
            marks.was_answered = work.done() or not is_running(rig)  # also a mission that has begun
            try:
                answers.append(await INTERRUPTIONS[interruption](rig))
                marks.answered = len(sent)
            except GcsError as error:
                answers.append(error)

        if interruption is not None:
            loop.at_step(step, lambda: answers.append(loop.create_task(interrupt())), seed)
        work = loop.observe(commanded())
        outcome = (await asyncio.gather(work, return_exceptions=True))[0]
        result.steps = loop.steps
        if interruption is None:
            assert not isinstance(outcome, BaseException), outcome
            return
        await sleep(SETTLE_S)
        result.problem = problem_of(rig, interruption, outcome, sent, marks)

    run_interleaved(scenario)
    return result


@functools.cache
def step_count(command):
    """Number of steps of an uninterrupted command; with the first, the command is accepted."""
    return run_case(command, None, 0, 0).steps


def test_every_command_that_moves_a_vehicle_has_a_case():
    moving = {row.name for row in ALL if row.acts == "moves"} - WITHOUT_A_CASE
    assert moving == {
        "offboard_mission/start" if name == "offboard_missions/start" else name for name in COMMANDS
    }


def check_sample(command, seed, count):
    chosen = random.Random(f"{command} {seed}")
    for _ in range(count):
        interruption = chosen.choice(list(INTERRUPTIONS))
        step = chosen.randint(2, step_count(command))
        order = chosen.randrange(1000)
        problem = run_case(command, interruption, step, order).problem
        assert problem is None, f"{command}, {interruption} at step {step} (seed {order}): {problem}"


@pytest.mark.parametrize("command", COMMANDS)
def test_after_an_interruption_was_answered_nothing_is_sent_for_the_earlier_command(command):
    check_sample(command, seed=1, count=6)


@pytest.mark.broad
@pytest.mark.parametrize("interruption", INTERRUPTIONS)
@pytest.mark.parametrize("command", COMMANDS)
def test_at_every_await_point_nothing_is_sent_after_the_interruption_was_answered(command, interruption):
    count = step_count(command)
    first = 2 + random.Random(f"{command} {interruption}").randrange(max(1, count // POINTS))
    for step in range(first, count + 1, max(1, count // POINTS)):
        problem = run_case(command, interruption, step, seed=step).problem
        assert problem is None, f"at step {step}: {problem}"
