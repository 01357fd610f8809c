"""Onboard logs read by pyulog: they have the values of the flight at the rates of PX4's logs."""

import gzip
import json
from io import BytesIO, FileIO

import numpy as np
import pytest
from pyulog import ULog

from tests.unit.vehicle_sim.sim_station import LAND_COMMAND, Station
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.parameters import Parameters
from vehicle_sim.px4_version import V1_16, VERSIONS
from vehicle_sim.ros2.messages import CODES, MESSAGES
from vehicle_sim.storage.files import VehicleFiles
from vehicle_sim.topics.layout import TopicLayout

pytestmark = pytest.mark.flight

ARM = 400
ARMED_AT_S, BOOT_UNIX_S = 12.0, 1795222005  # 2026-11-21 00:46:45 UTC
OPEN_FILE_EVENT_ID = 17980399
RECORDED_BEGINNING = (
    "554c6f67011235014072070000000000280042010000000000000000000000000000000000000000000000000000000000000000"
    "000000000000003800490f636861725b34305d207665725f7377366561333533393135376361333538633730613531353837"
    "386237373037376166376434363131641c00491775696e7433325f74207665725f73775f72656c65617365ff001001230049"
    "1e75696e7433325f74207665725f76656e646f725f73775f72656c65"
)
"""The first 180 bytes of a log of a real PX4."""


class Flight:
    """A v1.16, of which a log was recorded, that was armed for 3 s: its log, and the states of the simulation
    in that time."""

    def __init__(self, folder):
        files = VehicleFiles(folder)
        self.station = Station(log=True, boot_time_unix_s=BOOT_UNIX_S, files=[files], px4=V1_16)
        sim = self.station.sim
        self.station.run(ARMED_AT_S)
        assert sim.loggers[0].running
        sim.simulation.parameters[0].set("MPC_XY_CRUISE", 7.0)
        self.station.command(ARM, 1)
        self.states = {}
        for _ in range(round(3.0 / 0.004)):
            sim.step(0.004)
            estimate = sim.simulation.estimate
            self.states[round(sim.time_s * 1e6)] = (
                estimate.q_ned_frd[0].copy(), estimate.position_ned_m[0].copy(),
                sim.simulation.sensors.gyro_frd_rad_s[0].copy(), float(estimate.lat_deg[0]),
                sim.simulation.motors_us[0].copy(),
            )  # fmt: skip
        self.station.command(ARM, 0)
        self.station.run(0.9)
        assert sim.loggers[0].running
        self.station.run(0.3)
        assert not sim.loggers[0].running
        self.path = folder / sim.loggers[0].path
        self.log = ULog(str(self.path))
        self.data = {each.name: each.data for each in self.log.data_list}
        self.station.run(1.1)
        self.sensors = [m.onboard_control_sensors_present for m in self.station.received("SYS_STATUS")]


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    return Flight(tmp_path_factory.mktemp("vehicle"))


@pytest.mark.story
def test_sys_status_reports_whether_a_log_is_written(flight):
    assert flight.sensors[8] == 0x300402F
    assert flight.sensors[-1] == 0x200402F, "as recorded after a flight"


def test_a_log_is_named_by_its_time_and_begins_like_a_log_of_px4(flight):
    assert str(flight.path).endswith("log/2026-11-21/00_46_45.ulg")
    assert flight.path.read_bytes()[:180].hex() == RECORDED_BEGINNING
    assert flight.log.msg_info_dict["sys_name"] == "PX4"
    assert flight.log.msg_info_dict["time_ref_utc"] == 0
    assert not flight.log.dropouts
    assert not flight.log.file_corruption


@pytest.mark.parametrize(
    ("topic", "columns", "index"),
    [
        ("vehicle_attitude", [f"q[{k}]" for k in range(4)], 0),
        ("vehicle_local_position", ["x", "y", "z"], 1),
        ("sensor_combined", [f"gyro_rad[{k}]" for k in range(3)], 2),
        ("vehicle_global_position", ["lat"], 3),
        ("actuator_outputs", [f"output[{k}]" for k in range(4)], 4),
    ],
)
def test_logged_values_equal_the_values_of_the_simulation_at_the_same_time(flight, topic, columns, index):
    data = flight.data[topic]
    compared_count = 0
    for k, time_us in enumerate(data["timestamp"]):
        if int(time_us) in flight.states:
            logged = np.array([data[name][k] for name in columns])
            simulated = np.atleast_1d(flight.states[int(time_us)][index])
            assert logged == pytest.approx(
                np.round(simulated) if topic.endswith("outputs") else simulated, rel=1e-6
            )
            compared_count += 1
    assert compared_count >= 29


def test_motor_values_are_nan_until_armed(flight):
    motors = flight.data["actuator_motors"]
    before_arming = motors["timestamp"] < ARMED_AT_S * 1e6
    assert np.isnan(motors["control[0]"][before_arming]).all()
    armed = (motors["timestamp"] > (ARMED_AT_S + 0.5) * 1e6) & (motors["timestamp"] < (ARMED_AT_S + 3) * 1e6)
    assert (motors["control[0]"][armed] >= 0.0).all()
    assert np.isnan(motors["control[4]"]).all()


def test_state_topics_are_logged_when_they_change(flight):
    status = flight.data["vehicle_status"]
    armed_us = status["timestamp"][np.flatnonzero(status["arming_state"] == 2)[0]]
    assert armed_us == pytest.approx(ARMED_AT_S * 1e6, abs=30_000)
    assert status["armed_time"].max() == pytest.approx(ARMED_AT_S * 1e6, abs=30_000)
    assert set(status["nav_state"]) == {4}
    assert status["latest_arming_reason"].max() == 4
    assert flight.data["actuator_armed"]["armed"].max() == 1
    assert flight.data["battery_status"]["voltage_v"].min() > 14.0
    assert flight.data["estimator_status_flags"]["cs_gnss_pos"][-1] == 1
    assert flight.data["vehicle_land_detected"]["landed"][0] == 1


def test_each_topic_has_the_fields_and_the_rate_of_px4s_log(flight, reference_data):
    recording = json.loads((reference_data / "px4/logs/flight-short.json").read_text())
    recorded = {topic["name"]: topic for topic in recording["topics"] if topic["instance"] == 0}
    assert len(recorded.keys() & flight.data.keys()) >= 39
    for name, data in flight.data.items():
        assert name in recorded, f"{name} is no topic of PX4's log"
        assert not data.keys() - set(recorded[name]["fields"]), name
        times = data["timestamp"].astype(np.int64)
        assert (np.diff(times) > 0).all() or name == "event"
        hz = recorded[name]["hz"]
        if hz is not None and hz >= 5.0 and len(times) > 20:
            assert (len(times) - 1) / ((times[-1] - times[0]) / 1e6) == pytest.approx(hz, rel=0.03), name


def test_the_target_is_logged_with_the_types_and_the_altitudes_of_px4s_log(tmp_path, reference_data):
    """Takeoff, Hold and Land, as in the recorded log of a real PX4."""
    station = Station(log=True, files=[VehicleFiles(tmp_path)], sensor_noise=False)
    station.run_until(lambda: station.can_be_armed, 15)
    station.take_off_and_hover(4.0)
    station.run(1.0)
    station.command(LAND_COMMAND)
    station.run_until(lambda: not station.sim.autopilots[0].commander.armed, 40)
    station.run(0.5)

    def target(log):
        (data,) = (each.data for each in log.data_list if each.name == "position_setpoint_triplet")
        types = data["current.type"].tolist()
        changes = [n for n, kind in enumerate(types) if n == 0 or kind != types[n - 1]]
        valid = [(types[n], bool(data["current.valid"][n])) for n in changes]
        return valid, [data["current.alt"][n] == 0.0 for n in changes], data

    (path,) = tmp_path.rglob("*.ulg")
    valid, is_zero, data = target(ULog(str(path)))
    assert valid == [(5, False), (3, True), (2, True), (4, True), (5, False)]
    recorded = gzip.decompress((reference_data / "px4/logs/flight-short.ulg.gz").read_bytes())
    assert target(ULog(BytesIO(recorded)))[:2] == (valid, is_zero)
    hold = data["current.type"] == 2
    assert data["current.alt"][hold][0] == pytest.approx(
        station.sim.autopilots[0].home.alt_amsl_m + 4, abs=0.3
    )


BRIDGED = {
    "battery_status": "BatteryStatus", "failsafe_flags": "FailsafeFlags", "home_position": "HomePosition",
    "sensor_gps": "SensorGps", "vehicle_attitude_setpoint": "VehicleAttitudeSetpoint",
    "vehicle_control_mode": "VehicleControlMode", "vehicle_gps_position": "SensorGps",
    "vehicle_land_detected": "VehicleLandDetected", "vehicle_local_position": "VehicleLocalPosition",
    "vehicle_status": "VehicleStatus",
}  # fmt: skip
"""Logged topics that PX4 also bridges to ROS 2, with their types."""


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("topic", BRIDGED)
def test_a_topic_is_logged_with_the_fields_that_it_has_over_ros2_the_largest_first(topic, version):
    fields = sorted(MESSAGES[version][BRIDGED[topic]].fields, key=lambda each: -CODES[each.type][1])
    assert [(each.name, each.length) for each in TopicLayout(topic, 0, version).fields] == [
        (each.name, each.length) for each in fields
    ]


def test_vehicles_of_two_versions_in_a_fleet_log_the_fields_of_their_own_version(tmp_path):
    files = [VehicleFiles(tmp_path / version) for version in VERSIONS]
    stores = [Parameters({"SDLOG_MODE": 2}, px4=px4) for px4 in VERSIONS.values()]
    sim = SimulatedFleet(2, stores=stores, files=files, log=True, links=())
    sim.step(2.0)
    sim.close()
    old, new = (ULog(str(next((tmp_path / version).rglob("*.ulg")))) for version in VERSIONS)
    for name, gone, added in (
        ("battery_status", {"serial_number"}, set()),
        ("home_position", set(), {"roll", "pitch"}),
        ("sensor_gps", set(), {"authentication_state", "system_error"}),
        ("estimator_status_flags", set(), {"cs_gnss_fault", "cs_yaw_manual", "cs_gnss_hgt_fault"}),
    ):
        fields, new_fields = (log.get_dataset(name).data.keys() for log in (old, new))
        assert (fields - new_fields, new_fields - fields) == (gone, added)
    assert new.get_dataset("battery_status").data["voltage_v"].min() > 14.0
    assert not new.file_corruption


def test_initial_and_changed_parameters_are_logged(flight):
    log = flight.log
    assert len(log.initial_parameters) == 929
    assert log.initial_parameters["MPC_XY_CRUISE"] == pytest.approx(5.0)
    assert log.initial_parameters["SDLOG_MODE"] == 1
    changes = [(name, value) for _, name, value in log.changed_parameters]
    assert ("MPC_XY_CRUISE", pytest.approx(7.0)) in changes


def test_texts_and_events_are_logged(flight):
    texts = [(each.log_level_str(), each.message) for each in flight.log.logged_messages]
    assert ("INFO", "Armed by external command\t") in texts
    events = flight.data["event"]
    assert {OPEN_FILE_EVENT_ID} <= set(events["id"])
    assert events["event_sequence"].max() <= 0xFFFF


@pytest.mark.parametrize(
    ("mode", "expected"),
    [(0, (False, True, False)), (2, (True, True, True)),
     *(pytest.param(*each, marks=pytest.mark.broad) for each in (
         (-1, (False, False, False)), (1, (True, True, False)), (3, (False, False, False)),
         (4, (False, True, True))))],
)  # fmt: skip
def test_sdlog_mode_determines_when_a_log_is_written(mode, expected):
    station = Station(log=True, parameters={"SDLOG_MODE": mode})
    station.run_until(lambda: station.can_be_armed, 15)
    logger, commander = station.sim.loggers[0], station.sim.autopilots[0].commander
    running = [logger.running]
    assert commander.arm()
    station.run(0.1)
    running.append(logger.running)
    assert commander.disarm()
    station.run(1.5)
    running.append(logger.running)
    assert tuple(running) == expected
    station.sim.close()
    assert not logger.running


@pytest.mark.story
def test_the_next_arming_opens_a_new_file_and_reports_it():
    station = Station(log=True, boot_time_unix_s=BOOT_UNIX_S)
    station.run(12)
    for _ in range(2):
        station.command(ARM, 1)
        station.run(0.3)
        station.command(ARM, 0)
        station.run(0.3)
    logger = station.sim.loggers[0]
    assert logger.path == "log/2026-11-21/00_46_57.ulg"
    messages = station.received("EVENT", since_s=11.9)
    opened = [bytes(m.arguments)[:7] for m in messages if m.values["id"] == OPEN_FILE_EVENT_ID]
    assert opened == [bytes((0xEA, 0x07, 11, 21, 0, 46, 57))]
    assert f"[logger] ./{logger.path}\t" in station.status_texts(since_s=11.9)


def test_logs_of_the_same_second_get_different_names():
    sim = SimulatedFleet(log=True, parameters={"SDLOG_MODE": -1})
    sim.simulation.parameters[0].set("SDLOG_MODE", 0)
    sim.step(1.0)
    logger, paths = sim.loggers[0], []
    for _ in range(3):
        assert logger.start_manually()
        paths.append(logger.path)
        logger.stop_manual_log()
    assert len(set(paths)) == 3
    assert paths[1] == paths[0].replace(".ulg", "_01.ulg")


def test_the_default_log_profile_alone_has_lower_rates():
    sim = SimulatedFleet(log=True, parameters={"SDLOG_PROFILE": 1})
    sim.step(3.0)
    sim.close()
    log = ULog(str(sim.files[0].host_path(sim.loggers[0].path)))
    rates_hz = {each.name: len(each.data["timestamp"]) / 2.5 for each in log.data_list}
    assert rates_hz["vehicle_attitude"] == pytest.approx(20, abs=1)
    assert rates_hz["vehicle_local_position"] == pytest.approx(10, abs=1)
    assert rates_hz["estimator_status"] == pytest.approx(5, abs=1)


def test_each_vehicle_of_a_fleet_writes_its_own_log():
    sim = SimulatedFleet(3, log=True)
    sim.step(2.0)
    sim.loggers[1].stop()
    sim.step(1.0)
    sim.close()
    logs = [ULog(str(f.host_path(logger.path))) for f, logger in zip(sim.files, sim.loggers, strict=True)]
    ends_us = [log.last_timestamp for log in logs]
    assert ends_us[1] <= 2_004_000 < 2_900_000 < ends_us[0]
    east_m = [log.get_dataset("vehicle_local_position_groundtruth").data["y"][-1] for log in logs]
    assert east_m == pytest.approx([0.0, 3.0, 6.0], abs=1e-3)
    assert [int(log.get_dataset("vehicle_status").data["system_id"][0]) for log in logs] == [1, 2, 3]


def test_the_oldest_log_folders_are_removed_beyond_the_limit(tmp_path):
    for day in range(1, 11):
        (tmp_path / f"log/2026-01-{day:02d}").mkdir(parents=True)
    sim = SimulatedFleet(log=True, files=[VehicleFiles(tmp_path)], parameters={"SDLOG_DIRS_MAX": 3})
    sim.step(0.6)
    folders = sorted(entry.name for entry in (tmp_path / "log").iterdir())
    assert folders[:3] == ["2026-01-08", "2026-01-09", "2026-01-10"]
    assert len(folders) == 4


def test_a_folder_that_cannot_be_written_is_reported_and_the_vehicle_can_be_armed(tmp_path):
    (tmp_path / "log").write_text("in the way")
    station = Station(log=True, files=[VehicleFiles(tmp_path)], parameters={"SDLOG_MODE": 0})
    station.run_until(lambda: station.can_be_armed, 15)
    station.command(ARM, 1)
    station.run(0.3)
    assert station.armed
    assert not station.sim.loggers[0].running
    assert any(text.startswith("[logger] logging not started: ") for text in station.status_texts())


def test_a_full_disk_ends_only_the_log():
    station = Station(log=True)
    station.run(2)
    logger = station.sim.loggers[0]
    logger._file = FileIO("/dev/full", "wb")
    station.run(1)
    assert not logger.running
    assert "[logger] logging stopped: No space left on device\t" in station.status_texts()
    ended_s = station.now_s
    station.run(1)
    assert station.received("HEARTBEAT", since_s=ended_s)


def test_too_little_disk_space_is_reported_and_ends_the_log():
    station = Station(log=True, parameters={"SDLOG_MODE": 0})
    logger, free_bytes = station.sim.loggers[0], [10 << 20]
    logger._free_space = lambda path: free_bytes[0]
    station.run(2)
    assert not logger.start_manually()
    station.run(0.1)
    assert "[logger] not logging: 10 MiB free, 50 MiB required\t" in station.status_texts()
    assert "logger_storage_full" in station.events()
    free_bytes[0] = 10 << 30
    assert logger.start_manually()
    free_bytes[0] = 49 << 20
    station.run(5.1)
    assert not logger.running


def test_the_size_of_a_log_is_limited_and_the_next_arming_opens_another():
    station = Station(log=True)
    station.run_until(lambda: station.can_be_armed, 15)
    logger = station.sim.loggers[0]
    first_path, logger.written_bytes = logger.path, (1 << 30) + 1
    station.run(5.1)
    assert not logger.running
    assert "[logger] logging stopped: the log has reached 1 GiB\t" in station.status_texts()
    assert station.sim.autopilots[0].commander.arm()
    station.run(0.1)
    assert logger.running
    assert logger.path != first_path


def test_nothing_is_written_or_reported_while_logging_is_disabled():
    station = Station()
    station.run_until(lambda: station.can_be_armed, 15)
    assert station.sim.autopilots[0].commander.arm()
    station.run(0.5)
    assert not station.sim.loggers[0].start_manually()
    assert "logger_open_file_time" not in station.events()
    assert "root" not in vars(station.sim.files[0])  # no folder was created


@pytest.mark.story
def test_a_log_does_not_change_the_flight():
    flights = []
    for log in (False, True):
        sim = SimulatedFleet(log=log, seed=5)
        sim.step(12)
        assert sim.autopilots[0].commander.arm()
        sim.step(1)
        flights.append(sim.simulation.estimate.position_ned_m.tobytes())
    assert flights[0] == flights[1]
