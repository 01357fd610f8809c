"""PX4's console over MAVLink: echo, prompt, parts, and commands that do what they say."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.unit.vehicle_sim.sim_station import BOTH, Station
from vehicle_sim.shell.commands import BUILT_IN
from vehicle_sim.shell.console import PROMPT, Console
from vehicle_sim.topics.arrays import ARRAY_TOPICS

pytestmark = pytest.mark.flight


class Terminal:
    """Types into a vehicle's console."""

    def __init__(self, run_s=1.0, **fleet):
        self.station = Station(**fleet)
        self.station.run(run_s)

    def send(self, text, *, flags=6, via="gcs"):
        data = text.encode()
        self.station.send(
            "SERIAL_CONTROL", via=via, device=10, flags=flags, count=len(data), data=data, target_system=1,
            target_component=1,
        )  # fmt: skip

    def parts(self, since_s, via="gcs"):
        return [bytes(m.data[: m.count]) for m in self.station.heard("SERIAL_CONTROL", via, since_s + 0.001)]

    def shown(self, text, seconds=1.0, **options):
        since_s = self.station.now_s
        self.send(text, **options)
        self.station.run(seconds)
        return b"".join(self.parts(since_s, options.get("via", "gcs"))).decode()

    def ask(self, line):
        """What a command prints."""
        shown = self.shown(line + "\n")
        assert shown.startswith(line + "\n")
        assert shown.endswith(PROMPT)
        return shown[len(line) + 1 : -len(PROMPT)]


@pytest.fixture
def terminal():
    return Terminal(log=True)


@pytest.fixture
def ready():
    """Of a vehicle that may be armed."""
    return Terminal(12.0)


def test_a_line_is_echoed_answered_and_followed_by_the_prompt(terminal):
    assert terminal.shown("ver hw\n") == "ver hw\nHW arch: PX4_SITL\npxh> "
    assert terminal.shown("\n") == "\npxh> "
    reply = terminal.station.last["SERIAL_CONTROL"]
    assert (reply.device, reply.flags, reply.target_system, reply.target_component) == (10, 1, 255, 190)


def test_a_line_waits_for_its_end_and_closing_forgets_it(terminal):
    assert terminal.shown("ver ") == "ver "
    assert terminal.shown("hw\n") == "hw\nHW arch: PX4_SITL\npxh> "
    assert terminal.shown("nonsense") == "nonsense"
    assert terminal.shown("", flags=0) == ""
    assert terminal.shown("ver hw\n").endswith("PX4_SITL\npxh> ")


def test_what_is_unknown_is_named_and_what_is_not_simulated_says_so(terminal):
    assert terminal.ask("xyz") == "Invalid command: xyz\ntype 'help' for a list of commands\n"
    answer = terminal.ask("uuv_att_control start")
    assert answer.startswith("ERROR [uuv_att_control] the simulated vehicle has no such module\n")
    assert answer.endswith("Command 'uuv_att_control' failed, returned 1.\n")


def test_long_answers_come_in_parts_of_seventy_bytes_one_a_step(terminal):
    since_s = terminal.station.now_s
    terminal.send("help\n")
    terminal.station.run(0.04, tick_s=0.004)
    assert len(terminal.parts(since_s)) == 10
    terminal.station.run(1)
    parts = terminal.parts(since_s)
    assert {len(part) for part in parts[:-1]} == {70}
    assert b"".join(parts).decode().count("\n  ") == len(BUILT_IN)


def test_each_link_has_a_console_of_its_own():
    terminal = Terminal(links=BOTH)
    terminal.shown("ver ", via="gcs")
    assert terminal.shown("ver hw\n", via="api") == "ver hw\nHW arch: PX4_SITL\npxh> "
    assert terminal.shown("hw\n", via="gcs") == "hw\nHW arch: PX4_SITL\npxh> "


@pytest.mark.parametrize("fields", [{"device": 2}, {"target_system": 7}, {"target_component": 42}])
def test_other_devices_and_other_vehicles_are_not_this_console(terminal, fields):
    since_s = terminal.station.now_s
    values = {"device": 10, "target_system": 1, "target_component": 1, **fields}
    terminal.station.send("SERIAL_CONTROL", flags=6, count=4, data=b"ver\n", **values)
    terminal.station.run(0.3)
    assert terminal.parts(since_s) == []


def test_recorded_answers_come_back_word_for_word(ready, shared):
    lines = (shared / "px4/dialogues/shell.jsonl").read_text().splitlines()
    recorded = {d["id"]: d for d in map(json.loads, lines)}
    for name in ("shell_gimbal_status", "shell_help", "shell_param_show", "shell_again_after_exit"):
        theirs = "".join(r["fields"]["text"] for r in recorded[name]["received"])
        assert ready.shown(recorded[name]["send"][0]["fields"]["text"]) == theirs, name
    listened = "".join(r["fields"]["text"] for r in recorded["shell_listener"]["received"])
    ours = ready.shown("listener vehicle_status -n 1\n")
    assert [line.split(":")[0] for line in ours.splitlines()] == [
        line.split(":")[0] for line in listened.splitlines()
    ]


def test_parameters_are_shown_set_compared_and_reset_and_the_links_hear_of_it(terminal):
    store = terminal.station.sim.simulation.parameters[0]
    assert "curr: 12.0000 -> new: 8.5000" in terminal.ask("param set MPC_XY_VEL_MAX 8.5")
    assert store.get("MPC_XY_VEL_MAX") == 8.5
    told = [m for m in terminal.station.heard("PARAM_VALUE") if m.param_id == "MPC_XY_VEL_MAX"]
    assert told[-1].param_value == 8.5
    assert "x + MPC_XY_VEL_MAX [642,1109] : 8.5000\n" in terminal.ask("param show -c")
    assert terminal.ask("param show -q MPC_XY_VEL_MAX") == "8.5000\n"
    assert terminal.ask("param compare MPC_XY_VEL_MAX 1 8.5") == ""
    assert terminal.ask("param compare MPC_XY_VEL_MAX 9") == "Command 'param' failed, returned 1.\n"
    assert terminal.ask("param greater MPC_XY_VEL_MAX 8") == ""
    assert terminal.ask("param reset MPC_XY*") == ""
    assert store.get("MPC_XY_VEL_MAX") == 12.0
    told = [m for m in terminal.station.heard("PARAM_VALUE") if m.param_id == "MPC_XY_VEL_MAX"]
    assert told[-1].param_value == 8.5, "PX4 tells changes, not resets"
    assert "1 differ from" in terminal.ask("param set COM_OF_LOSS_T 3") + terminal.ask("param status")
    terminal.ask("param reset_all COM_*")
    assert store.get("COM_OF_LOSS_T") == 3.0
    assert store.get("CAL_ACC0_ID") == 0


@pytest.mark.parametrize(
    ("line", "says"),
    [("param set NOPE 1", "no parameter NOPE"), ("param set MPC_XY_VEL_MAX fast", "'fast' is no FLOAT"),
     ("param set COM_OBL_RC_ACT 1.5", "'1.5' is no INT32"), ("param fly", "unknown: fly"),
     ("param", "Usage: param"), ("param index 5000", "0 to 928")],
)  # fmt: skip
def test_a_wrong_param_line_says_what_is_wrong(terminal, line, says):
    answer = terminal.ask(line)
    assert says in answer
    assert "failed, returned 1" in answer


@pytest.mark.story
def test_the_commander_arms_takes_off_and_lands_from_here(ready):
    assert "Disarmed" in ready.ask("commander status")
    assert "Preflight check: OK" in ready.ask("commander check")
    assert ready.ask("commander takeoff") == ""
    station = ready.station
    assert station.armed
    assert "Armed by internal command\t" in station.texts()
    station.run(12)
    assert station.height_m > 1.5
    status = ready.ask("commander status")
    assert "Armed" in status
    assert "landed: no" in status
    assert "the vehicle is flying; -f forces it" in ready.ask("commander disarm")
    assert ready.ask("commander mode auto:land") == ""
    station.run_until(lambda: not station.armed, 30)
    assert "no such mode" in ready.ask("commander mode hover")


def test_the_gimbal_is_given_away_and_turned(terminal):
    terminal.ask("gimbal primary-control 255 190")
    gimbal = terminal.station.sim.autopilots[0].gimbal
    assert gimbal.primary == (255, 190)
    assert "Primary control:   255/190" in terminal.ask("gimbal status")
    assert terminal.ask("gimbal test pitch -30") == ""
    terminal.station.run(1)
    assert gimbal.actual.pitch_rad == pytest.approx(math.radians(-30), abs=0.02)
    assert "pitch: -30.0 deg" in terminal.ask("gimbal status")
    assert "already running" in terminal.ask("gimbal start")
    assert "lie within 0 to 255" in terminal.ask("gimbal primary-control 999 1")


def test_without_its_input_the_gimbal_does_not_run():
    terminal = Terminal(parameters={"MNT_MODE_IN": -1})
    assert "not running" in terminal.ask("gimbal status")
    assert "MNT_MODE_IN" in terminal.ask("gimbal start")


@pytest.mark.story
def test_the_listener_shows_every_topic_of_the_logger(terminal):
    states = [topic.layout.name for topic in terminal.station.sim.loggers[0]._states.topics]
    for name in [topic.layout.name for topic in ARRAY_TOPICS] + states:
        answer = terminal.ask(f"listener {name}")
        assert answer.startswith(f"\nTOPIC: {name}\n {name}\n    timestamp: "), name
    q = terminal.station.sim.simulation.estimate.q_ned_frd[0]
    line = next(x for x in terminal.ask("listener vehicle_attitude").splitlines() if x.startswith("    q: "))
    assert [float(x) for x in line[8:-1].split(", ")] == pytest.approx(q.tolist(), abs=2e-3)
    assert "did not match" in terminal.ask("listener nothing")


def test_the_listener_takes_its_time_for_several_samples(terminal):
    shown = terminal.shown("listener sensor_baro -n 3\nver hw\n", 1.5)
    assert shown.count("TOPIC: sensor_baro") == 2
    assert "HW arch" not in shown
    since_s = terminal.station.now_s
    terminal.station.run(1.5)
    rest = b"".join(terminal.parts(since_s)).decode()
    assert rest.count("TOPIC: sensor_baro") == 1
    assert rest.endswith("HW arch: PX4_SITL\npxh> ")


def test_failures_are_injected_where_the_vehicle_allows_it():
    terminal = Terminal(parameters={"SYS_FAILURE_EN": 1})
    assert terminal.ask("failure battery off") == ""
    assert terminal.station.sim.simulation.battery.voltage_v[0] == pytest.approx(14.4)
    assert "failure slow of motor is not supported" in terminal.ask("failure motor slow")
    assert "failure slow of gps is not supported" in terminal.ask("failure gps slow")
    terminal.ask("param set SYS_FAILURE_EN 0")
    assert "SYS_FAILURE_EN" in terminal.ask("failure gps off")


@pytest.mark.parametrize(
    ("driver", "count", "reading"),
    [
        ("sensor_gps_sim", "gps_fresh", "gps_lat_deg"),
        ("sensor_baro_sim", "baro_fresh", "baro_pressure_hpa"),
        ("sensor_mag_sim", "mag_fresh", "mag_frd_gauss"),
    ],
)
def test_a_stopped_driver_is_a_silent_sensor(terminal, driver, count, reading):
    sensors = terminal.station.sim.simulation.sensors
    assert "running" in terminal.ask(f"{driver} status")
    assert "already running" in terminal.ask(f"{driver} start")
    assert terminal.ask(f"{driver} stop") == ""
    terminal.station.run(0.3)
    last = getattr(sensors, reading).copy()
    terminal.station.run(0.5)
    assert not getattr(sensors, count)[0]
    assert np.array_equal(getattr(sensors, reading), last)
    assert "not running" in terminal.ask(f"{driver} status")
    assert terminal.ask(f"{driver} start") == ""
    terminal.station.run(0.3)
    assert getattr(sensors, count)[0]
    assert not np.array_equal(getattr(sensors, reading), last)


def test_the_log_is_begun_and_ended_by_hand(terminal):
    assert "Full File Logging Running: ./log/" in terminal.ask("logger status")
    logger = terminal.station.sim.loggers[0]
    terminal.ask("logger off")
    assert not logger.running
    assert "Not logging" in terminal.ask("logger status")
    terminal.ask("logger on")
    assert logger.running


def test_parts_of_the_vehicle_tell_of_themselves(ready):
    assert "gps: fix type 3" in ready.ask("sensors status")
    assert "local position: valid" in ready.ask("ekf2 status")
    assert "\tGCS heartbeat valid\n" in ready.ask("mavlink status")
    assert "HEARTBEAT " in ready.ask("mavlink status streams")
    assert "vehicle_attitude " in ready.ask("uorb top")
    assert "2026" in ready.ask("system_time get")
    assert ready.ask("ver hwcmp PX4_SITL") == ""


@settings(max_examples=150, deadline=None)
@given(
    name=st.sampled_from([*BUILT_IN, "exit"]),
    rest=st.lists(
        st.sampled_from(
            ["status", "set", "show", "-n", "-r", "-i", "NaN", "1e999", "-1", "99999999999999", "*", "mode",
             "test", "pitch", "primary-control", "vehicle_status", "SYS_AUTOSTART", "MPC_XY_P", "²", "top"]
        ) | st.text(max_size=8),
        max_size=4,
    ),
)  # fmt: skip
def test_any_line_ends_with_a_prompt(console, name, rest):
    shown = console.type(" ".join([name, *rest]).replace("\n", " ") + "\n")
    assert shown.endswith(PROMPT) or console.busy
    console._running = None


@pytest.fixture(scope="module")
def console():
    station = Station()
    station.run(1)
    node = station.sim.nodes[0]
    made: Console = node._shell.console()
    return made


def test_a_flood_of_lines_stops_nobody(terminal):
    for _ in range(300):
        terminal.send("listener vehicle_local_position\n" * 2)
    since_s = terminal.station.now_s
    terminal.station.run(1)
    assert terminal.station.heard("HEARTBEAT", since_s=since_s)
    session = terminal.station.sim.nodes[0]._shell._sessions["gcs"]
    assert len(session.waiting) <= 200_000
