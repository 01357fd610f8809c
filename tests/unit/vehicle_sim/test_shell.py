"""PX4's console over MAVLink: echo, prompt, long outputs, and commands."""

import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.unit.vehicle_sim.sim_station import GCS_AND_API_LINKS, Station
from vehicle_sim.px4_version import V1_16
from vehicle_sim.shell.commands import BUILT_IN
from vehicle_sim.shell.console import PROMPT, Console
from vehicle_sim.topics.arrays import array_topics

pytestmark = [pytest.mark.flight, pytest.mark.story]


class Terminal:
    """A terminal connected to the console of a v1.16, of which it was recorded."""

    def __init__(self, run_s=1.0, **fleet):
        self.station = Station(px4=V1_16, **fleet)
        self.station.run(run_s)

    def send(self, text, *, flags=6, via="gcs"):
        """Sends a text to the console; flags 6 are RESPOND and EXCLUSIVE."""
        data = text.encode()
        self.station.send(
            "SERIAL_CONTROL", via=via, device=10, flags=flags, count=len(data), data=data, target_system=1,
            target_component=1,
        )  # fmt: skip

    def parts(self, since_s, via="gcs"):
        """Data of the messages that the console sent after this time."""
        return [
            bytes(m.data[: m.count]) for m in self.station.received("SERIAL_CONTROL", via, since_s + 0.001)
        ]

    def send_and_read(self, text, seconds=1.0, **options):
        """Sends a text; returns all that the console sends in this time."""
        since_s = self.station.now_s
        self.send(text, **options)
        self.station.run(seconds)
        return b"".join(self.parts(since_s, options.get("via", "gcs"))).decode()

    def output_of(self, line):
        """Runs a command; returns its output."""
        output = self.send_and_read(line + "\n")
        assert output.startswith(line + "\n")
        assert output.endswith(PROMPT)
        return output[len(line) + 1 : -len(PROMPT)]


@pytest.fixture
def terminal():
    return Terminal(log=True)


@pytest.fixture
def ready_terminal():
    """The terminal of a vehicle that can be armed."""
    return Terminal(12.0)


def test_a_line_is_echoed_and_its_output_ends_with_the_prompt(terminal):
    assert terminal.send_and_read("ver hw\n") == "ver hw\nHW arch: PX4_SITL\npxh> "
    assert terminal.send_and_read("\n") == "\npxh> "
    reply = terminal.station.newest_messages["SERIAL_CONTROL"]
    assert (reply.device, reply.flags, reply.target_system, reply.target_component) == (10, 1, 255, 190)


def test_a_line_is_executed_at_its_end_and_discarded_when_the_console_is_closed(terminal):
    assert terminal.send_and_read("ver ") == "ver "
    assert terminal.send_and_read("hw\n") == "hw\nHW arch: PX4_SITL\npxh> "
    assert terminal.send_and_read("nonsense") == "nonsense"
    assert terminal.send_and_read("", flags=0) == ""
    assert terminal.send_and_read("ver hw\n").endswith("PX4_SITL\npxh> ")


def test_unknown_and_not_simulated_commands_are_reported(terminal):
    assert terminal.output_of("xyz") == "Invalid command: xyz\ntype 'help' for a list of commands\n"
    output = terminal.output_of("uuv_att_control start")
    assert output.startswith("ERROR [uuv_att_control] the simulated vehicle has no such module\n")
    assert output.endswith("Command 'uuv_att_control' failed, returned 1.\n")


def test_long_outputs_are_sent_in_parts_of_70_bytes_one_part_per_step(terminal):
    since_s = terminal.station.now_s
    terminal.send("help\n")
    terminal.station.run(0.04, tick_s=0.004)
    assert len(terminal.parts(since_s)) == 10
    terminal.station.run(1)
    parts = terminal.parts(since_s)
    assert {len(part) for part in parts[:-1]} == {70}
    assert b"".join(parts).decode().count("\n  ") == len(BUILT_IN)


def test_each_link_has_its_own_console():
    terminal = Terminal(links=GCS_AND_API_LINKS)
    terminal.send_and_read("ver ", via="gcs")
    assert terminal.send_and_read("ver hw\n", via="api") == "ver hw\nHW arch: PX4_SITL\npxh> "
    assert terminal.send_and_read("hw\n", via="gcs") == "hw\nHW arch: PX4_SITL\npxh> "


@pytest.mark.parametrize("fields", [{"device": 2}, {"target_system": 7}, {"target_component": 42}])
def test_messages_to_other_devices_and_vehicles_are_ignored(terminal, fields):
    since_s = terminal.station.now_s
    values = {"device": 10, "target_system": 1, "target_component": 1, **fields}
    terminal.station.send("SERIAL_CONTROL", flags=6, count=4, data=b"ver\n", **values)
    terminal.station.run(0.3)
    assert terminal.parts(since_s) == []


def test_outputs_equal_the_recorded_outputs(ready_terminal, reference_data):
    lines = (reference_data / "px4/dialogues/shell.jsonl").read_text().splitlines()
    dialogues = {dialogue["id"]: dialogue for dialogue in map(json.loads, lines)}
    for name in ("shell_gimbal_status", "shell_help", "shell_param_show", "shell_again_after_exit"):
        recorded_output = "".join(r["fields"]["text"] for r in dialogues[name]["received"])
        assert (
            ready_terminal.send_and_read(dialogues[name]["send"][0]["fields"]["text"]) == recorded_output
        ), name
    recorded_listing = "".join(r["fields"]["text"] for r in dialogues["shell_listener"]["received"])
    listing = ready_terminal.send_and_read("listener vehicle_status -n 1\n")
    assert [line.split(":")[0] for line in listing.splitlines()] == [
        line.split(":")[0] for line in recorded_listing.splitlines()
    ]


def test_parameters_are_shown_set_compared_and_reset_and_changes_are_sent(terminal):
    store = terminal.station.sim.simulation.parameters[0]
    assert "curr: 12.0000 -> new: 8.5000" in terminal.output_of("param set MPC_XY_VEL_MAX 8.5")
    assert store.get("MPC_XY_VEL_MAX") == 8.5
    sent = [m for m in terminal.station.received("PARAM_VALUE") if m.param_id == "MPC_XY_VEL_MAX"]
    assert sent[-1].param_value == 8.5
    assert "x + MPC_XY_VEL_MAX [642,1109] : 8.5000\n" in terminal.output_of("param show -c")
    assert terminal.output_of("param show -q MPC_XY_VEL_MAX") == "8.5000\n"
    assert terminal.output_of("param compare MPC_XY_VEL_MAX 1 8.5") == ""
    assert terminal.output_of("param compare MPC_XY_VEL_MAX 9") == "Command 'param' failed, returned 1.\n"
    assert terminal.output_of("param greater MPC_XY_VEL_MAX 8") == ""
    assert terminal.output_of("param reset MPC_XY*") == ""
    assert store.get("MPC_XY_VEL_MAX") == 12.0
    sent = [m for m in terminal.station.received("PARAM_VALUE") if m.param_id == "MPC_XY_VEL_MAX"]
    assert sent[-1].param_value == 8.5, "a reset was sent"
    assert "1 differ from" in terminal.output_of("param set COM_OF_LOSS_T 3") + terminal.output_of(
        "param status"
    )
    terminal.output_of("param reset_all COM_*")
    assert store.get("COM_OF_LOSS_T") == 3.0
    assert store.get("CAL_ACC0_ID") == 0


@pytest.mark.parametrize(
    ("line", "expected"),
    [("param set NOPE 1", "no parameter NOPE"),
     ("param set MPC_XY_VEL_MAX fast", "'fast' is not a value of type FLOAT"),
     ("param set COM_OBL_RC_ACT 1.5", "'1.5' is not a value of type INT32"), ("param fly", "unknown: fly"),
     ("param", "Usage: param"), ("param index 5000", "0 to 928")],
)  # fmt: skip
def test_an_invalid_param_command_is_explained(terminal, line, expected):
    output = terminal.output_of(line)
    assert expected in output
    assert "failed, returned 1" in output


def test_commander_commands_arm_take_off_and_land(ready_terminal):
    assert "Disarmed" in ready_terminal.output_of("commander status")
    assert "Preflight check: OK" in ready_terminal.output_of("commander check")
    assert ready_terminal.output_of("commander takeoff") == ""
    station = ready_terminal.station
    assert station.armed
    assert "Armed by internal command\t" in station.status_texts()
    station.run(12)
    assert station.height_m > 1.5
    status = ready_terminal.output_of("commander status")
    assert "Armed" in status
    assert "landed: no" in status
    assert "the vehicle is flying; -f disarms in flight" in ready_terminal.output_of("commander disarm")
    assert ready_terminal.output_of("commander mode auto:land") == ""
    station.run_until(lambda: not station.armed, 30)
    assert "no such mode" in ready_terminal.output_of("commander mode hover")


def test_gimbal_commands_set_control_and_angles(terminal):
    terminal.output_of("gimbal primary-control 255 190")
    gimbal = terminal.station.sim.autopilots[0].gimbal
    assert gimbal.primary == (255, 190)
    assert "Primary control:   255/190" in terminal.output_of("gimbal status")
    assert terminal.output_of("gimbal test pitch -30") == ""
    terminal.station.run(1)
    assert gimbal.actual.pitch_rad == pytest.approx(math.radians(-30), abs=0.02)
    assert "pitch: -30.0 deg" in terminal.output_of("gimbal status")
    assert "already running" in terminal.output_of("gimbal start")
    assert "component ids are 0 to 255" in terminal.output_of("gimbal primary-control 999 1")


def test_a_gimbal_without_input_runs_after_start_and_takes_commands_after_another_start():
    terminal = Terminal(parameters={"MNT_MODE_IN": -1})
    gimbal = terminal.station.sim.autopilots[0].gimbal
    assert "not running" in terminal.output_of("gimbal status")
    assert "MNT_MODE_IN" in terminal.output_of("gimbal start")
    assert (gimbal.running, gimbal.enabled) == (True, False)
    assert "Input: Mavlink" not in terminal.output_of("gimbal status")
    terminal.output_of("param set MNT_MODE_IN 4")
    assert not gimbal.enabled
    assert "already running" in terminal.output_of("gimbal start")
    terminal.output_of("gimbal primary-control 1 1")
    assert terminal.output_of("gimbal stop") == ""
    assert terminal.output_of("gimbal start") == ""
    status = terminal.output_of("gimbal status")
    assert "Input: Mavlink" in status
    assert "Primary control:   0/0" in status


def test_the_listener_shows_every_topic_of_the_logger(terminal):
    state_topics = [topic.layout.name for topic in terminal.station.sim.loggers[0]._states.topics]
    for name in [topic.layout.name for topic in array_topics(V1_16.name)] + state_topics:
        output = terminal.output_of(f"listener {name}")
        assert output.startswith(f"\nTOPIC: {name}\n {name}\n    timestamp: "), name
    q = terminal.station.sim.simulation.estimate.q_ned_frd[0]
    line = next(
        x for x in terminal.output_of("listener vehicle_attitude").splitlines() if x.startswith("    q: ")
    )
    assert [float(x) for x in line[8:-1].split(", ")] == pytest.approx(q.tolist(), abs=2e-3)
    assert "did not match" in terminal.output_of("listener nothing")


def test_the_listener_waits_for_several_samples(terminal):
    first_output = terminal.send_and_read("listener sensor_baro -n 3\nver hw\n", 1.5)
    assert first_output.count("TOPIC: sensor_baro") == 2
    assert "HW arch" not in first_output
    since_s = terminal.station.now_s
    terminal.station.run(1.5)
    later_output = b"".join(terminal.parts(since_s)).decode()
    assert later_output.count("TOPIC: sensor_baro") == 1
    assert later_output.endswith("HW arch: PX4_SITL\npxh> ")


def test_failures_are_injected_only_if_enabled():
    terminal = Terminal(parameters={"SYS_FAILURE_EN": 1})
    assert terminal.output_of("failure battery off") == ""
    assert terminal.station.sim.simulation.battery.voltage_v[0] == pytest.approx(14.4)
    assert "failure slow of motor is not supported" in terminal.output_of("failure motor slow")
    assert "failure slow of gps is not supported" in terminal.output_of("failure gps slow")
    terminal.output_of("param set SYS_FAILURE_EN 0")
    assert "SYS_FAILURE_EN" in terminal.output_of("failure gps off")


@pytest.mark.parametrize(
    ("driver", "fresh_flag", "reading"),
    [
        ("sensor_gps_sim", "gps_fresh", "gps_lat_deg"),
        ("sensor_baro_sim", "baro_fresh", "baro_pressure_hpa"),
        ("sensor_mag_sim", "mag_fresh", "mag_frd_gauss"),
    ],
)
def test_the_sensor_of_a_stopped_driver_sends_no_samples(terminal, driver, fresh_flag, reading):
    sensors = terminal.station.sim.simulation.sensors
    assert "running" in terminal.output_of(f"{driver} status")
    assert "already running" in terminal.output_of(f"{driver} start")
    assert terminal.output_of(f"{driver} stop") == ""
    terminal.station.run(0.3)
    last_reading = getattr(sensors, reading).copy()
    terminal.station.run(0.5)
    assert not getattr(sensors, fresh_flag)[0]
    assert np.array_equal(getattr(sensors, reading), last_reading)
    assert "not running" in terminal.output_of(f"{driver} status")
    assert terminal.output_of(f"{driver} start") == ""
    terminal.station.run(0.3)
    assert getattr(sensors, fresh_flag)[0]
    assert not np.array_equal(getattr(sensors, reading), last_reading)


def test_logger_commands_start_and_stop_the_log(terminal):
    assert "Full File Logging Running: ./log/" in terminal.output_of("logger status")
    logger = terminal.station.sim.loggers[0]
    terminal.output_of("logger off")
    assert not logger.running
    assert "Not logging" in terminal.output_of("logger status")
    terminal.output_of("logger on")
    assert logger.running


def test_status_commands_show_the_state_of_modules(ready_terminal):
    assert "gps: fix type 3" in ready_terminal.output_of("sensors status")
    assert "local position: valid" in ready_terminal.output_of("ekf2 status")
    assert "\tGCS heartbeat valid\n" in ready_terminal.output_of("mavlink status")
    assert "HEARTBEAT " in ready_terminal.output_of("mavlink status streams")
    assert "vehicle_attitude " in ready_terminal.output_of("uorb top")
    assert "2026" in ready_terminal.output_of("system_time get")
    assert ready_terminal.output_of("ver hwcmp PX4_SITL") == ""


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
    shown = console.receive_text(" ".join([name, *rest]).replace("\n", " ") + "\n")
    assert shown.endswith(PROMPT) or console.busy
    console._running = None


@pytest.fixture(scope="module")
def console():
    station = Station()
    station.run(1)
    node = station.sim.nodes[0]
    console: Console = node._shell.console()
    return console


def test_a_flood_of_lines_takes_limited_memory_and_telemetry_continues(terminal):
    for _ in range(300):
        terminal.send("listener vehicle_local_position\n" * 2)
    since_s = terminal.station.now_s
    terminal.station.run(1)
    assert terminal.station.received("HEARTBEAT", since_s=since_s)
    session = terminal.station.sim.nodes[0]._shell._sessions["gcs"]
    assert len(session.unsent) <= 200_000
