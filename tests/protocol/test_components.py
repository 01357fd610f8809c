"""The server distinguishes a vehicle's components by their ids, and no component replaces the autopilot."""

import asyncio

import pytest

from gcs_server.api import command_routes, models, vehicle_routes
from gcs_server.errors import InvalidRequest, NoReply
from gcs_server.vehicle.components import LOST_AFTER_S, MAX_COMPONENTS
from gcs_server.vehicle.services.camera import CameraService
from tests.protocol.api_calls import ANNA, journal_entries, json_of, new_station
from tests.protocol.command_numbers import (
    GIMBAL_CONFIGURE,
    GIMBAL_PITCHYAW,
    IMAGE_START_CAPTURE,
    REQUEST_MESSAGE,
)
from tests.protocol.memory_testbed import MemoryTestbed, run_with_vehicle
from tests.protocol.offboard_testbed import OffboardTestbed
from vehicle_sim.mavlink import generated_dialect as sim

Q_LEVEL, Q_DOWN, Q_HALF_DOWN = (
    [1.0, 0.0, 0.0, 0.0],
    [0.7071068, 0.0, -0.7071068, 0.0],
    [0.9238795, 0.0, -0.3826834, 0.0],
)
CAMERA, COMPANION, GIMBAL = sim.MAV_TYPE_CAMERA, sim.MAV_TYPE_ONBOARD_CONTROLLER, sim.MAV_TYPE_GIMBAL
PITCH_DOWN_RAD = pytest.approx(-1.5708, abs=1e-2)


class OtherComponent:
    """Another component of the vehicle: a gimbal manager or a camera; it acknowledges every command."""

    def __init__(self, autopilot, component_id, mav_type):
        self.autopilot, self.id, self.mav_type = autopilot, component_id, mav_type
        self.mav = sim.MAVLink(None, srcSystem=1, srcComponent=component_id)
        self.received_messages, self.control_by_device = [], {}
        autopilot.handlers.append(self.handle)

    def send(self, message):
        self.autopilot.send_raw(message.pack(self.mav))

    def send_heartbeat(self, autopilot=8):
        self.send(sim.MAVLink_heartbeat_message(self.mav_type, autopilot, 0, 0, 4, 3))

    def send_attitude(self, q, device=0):
        boot_ms = self.autopilot.boot_ms()
        self.send(
            sim.MAVLink_gimbal_device_attitude_status_message(
                0, 0, boot_ms, 0, q, 0, 0, 0, 0, gimbal_device_id=device
            )
        )

    def send_status(self, device):
        primary = self.control_by_device.get(device, (0, 0))
        self.send(
            sim.MAVLink_gimbal_manager_status_message(self.autopilot.boot_ms(), 0, device, *primary, 0, 0)
        )

    def send_limits(self, device, pitch_rad):
        self.send(
            sim.MAVLink_gimbal_manager_information_message(
                self.autopilot.boot_ms(), 0, device, 0, 0, -pitch_rad, pitch_rad, -1, 1
            )
        )

    def handle(self, message):
        if getattr(message, "target_component", 0) != self.id:
            return False
        self.received_messages.append(message)
        if message.get_type() != "COMMAND_LONG":
            return True
        if message.command == REQUEST_MESSAGE:
            for device in self.control_by_device or {self.id: None}:
                self.send_status(device)
        if message.command == GIMBAL_CONFIGURE:
            self.control_by_device[int(message.param7) or self.id] = (
                int(message.param1),
                int(message.param2),
            )
        self.send(sim.MAVLink_command_ack_message(message.command, 0, 0, 0, 255, 190))
        return True

    def received_commands(self, command):
        return [m for m in self.received_messages if getattr(m, "command", None) == command]


async def call_repeatedly(seconds, *work):
    """Calls each function ten times a second."""
    for _ in range(round(seconds * 10)):
        for each in work:
            each()
        await asyncio.sleep(0.1)


def picture_counts(*cameras):
    """How many pictures each camera was commanded to take."""
    return tuple(len(camera.received_commands(IMAGE_START_CAPTURE)) for camera in cameras)


def component_states(vehicle):
    return [(c.component_id, c.kind, c.lost) for c in vehicle.components.all()]


def test_components_are_known_by_their_heartbeats_until_they_are_lost(run_simulated):
    async def scenario(testbed, autopilot, vehicle):
        camera, companion = OtherComponent(autopilot, 101, CAMERA), OtherComponent(autopilot, 191, COMPANION)
        gimbal, other = OtherComponent(autopilot, 154, GIMBAL), OtherComponent(autopilot, 68, 0)
        await call_repeatedly(
            3, camera.send_heartbeat, companion.send_heartbeat, gimbal.send_heartbeat, other.send_heartbeat
        )
        expected = [(1, "autopilot", False), (68, "other", False), (101, "camera", False)]
        assert component_states(vehicle) == [*expected, (154, "gimbal", False), (191, "companion", False)]
        assert all(c.last_heard_unix_s is None for c in vehicle.components.all())
        await asyncio.sleep(1)
        lost_since_unix_s = testbed.clock.unix_s() - 1
        await call_repeatedly(
            LOST_AFTER_S, camera.send_heartbeat, companion.send_heartbeat, other.send_heartbeat
        )
        (lost_component,) = [c for c in vehicle.components.all() if c.lost]
        assert (lost_component.component_id, lost_component.last_heard_unix_s) == (
            154,
            pytest.approx(lost_since_unix_s, abs=0.3),
        )
        await call_repeatedly(1, gimbal.send_heartbeat)
        texts = [e.text for e in vehicle.events.since() if e.kind == "component"]
        assert sorted(texts[:4]) == [
            "Camera 101 connected",
            "Companion 191 connected",
            "Component 68 connected",
            "Gimbal 154 connected",
        ]
        assert texts[4:] == ["Gimbal 154: connection lost", "Gimbal 154: connection restored"]
        assert json_of(await vehicle_routes.show_vehicle(vehicle))["components"][1] == {
            "component_id": 68, "kind": "other", "mav_type": 0, "lost": False, "last_heard_unix_s": None,
        }  # fmt: skip

    run_with_vehicle(run_simulated, scenario)


def test_the_number_of_components_is_limited(run_simulated):
    async def scenario(testbed, autopilot, vehicle):
        for component_id in range(2, 256):
            OtherComponent(autopilot, component_id, 0).send_heartbeat()
            await asyncio.sleep(0.01)
        await asyncio.sleep(0.1)
        assert len(vehicle.components.all()) == MAX_COMPONENTS
        assert component_states(vehicle)[0] == (1, "autopilot", False)
        assert not vehicle.status.link_lost

    run_with_vehicle(run_simulated, scenario)


def test_a_peripheral_that_claims_to_be_an_autopilot_does_not_become_the_vehicle(run_simulated):
    async def run():
        testbed = MemoryTestbed()
        try:
            autopilot = testbed.autopilot(testbed.link())
            autopilot.alive = False
            impostor, camera = (
                OtherComponent(autopilot, 191, sim.MAV_TYPE_QUADROTOR),
                OtherComponent(autopilot, 7, CAMERA),
            )
            autopilot.alive = True
            impostor.send_heartbeat(autopilot=12)
            camera.send_heartbeat(autopilot=12)
            vehicle = await testbed.wait_for_vehicle()
            await call_repeatedly(
                2, lambda: impostor.send_heartbeat(autopilot=12), lambda: camera.send_heartbeat(autopilot=12)
            )
            assert [v.id for v in testbed.fleet.all()] == ["1"]
            assert vehicle.identity.component_id == 1
            assert component_states(vehicle)[0] == (1, "autopilot", False)
        finally:
            await testbed.close()

    run_simulated(run)


def test_batteries_and_distances_of_another_component_do_not_replace_those_of_the_autopilot(run_simulated):
    async def scenario(testbed, autopilot, vehicle):
        battery = OtherComponent(autopilot, 180, sim.MAV_TYPE_BATTERY)
        cells = [16000, *[65535] * 9]
        autopilot.send(sim.MAVLink_battery_status_message(0, 0, 0, 0, cells, 100, 0, 0, 80))
        for sensor_id, distance_cm in ((0, 300), (1, 400)):
            autopilot.send(sim.MAVLink_distance_sensor_message(0, 10, 900, distance_cm, 0, sensor_id, 0, 0))
        await call_repeatedly(
            2,
            lambda: battery.send(sim.MAVLink_battery_status_message(0, 0, 0, 0, cells, 100, 0, 0, 3)),
            lambda: battery.send(sim.MAVLink_distance_sensor_message(0, 10, 900, 50, 0, 0, 0, 0)),
        )
        assert vehicle.topic("battery").value.remaining_percent == 80
        sensors = vehicle.topic("distance_sensors").value.sensors
        assert [(s.sensor_id, s.distance_m) for s in sensors] == [(0, 3.0), (1, 4.0)]

    run_with_vehicle(run_simulated, scenario)


def test_two_gimbals_are_distinguished_and_commanded_separately(run_simulated):
    async def scenario(testbed, autopilot, vehicle):
        station = new_station(testbed)
        second_gimbal = OtherComponent(autopilot, 171, GIMBAL)
        second_gimbal.control_by_device[171] = (0, 0)

        def send_both_attitudes():
            autopilot.send_gimbal_attitude()
            second_gimbal.send_attitude(Q_DOWN)

        second_gimbal.send_limits(171, 0.5)
        await call_repeatedly(4, send_both_attitudes, lambda: second_gimbal.send_status(171))
        value = vehicle.topic("gimbal").value
        assert [(g.component_id, g.gimbal_device_id, g.pitch_rad) for g in value.gimbals] == [
            (1, 1, pytest.approx(0.0, abs=1e-3)),
            (171, 171, PITCH_DOWN_RAD),
        ]
        assert (value.component_id, value.pitch_max_rad, value.gimbals[1].pitch_max_rad) == (1, None, 0.5)

        async def call(request):
            sending = asyncio.ensure_future(call_repeatedly(6, send_both_attitudes))
            try:
                return json_of(await request)
            finally:
                sending.cancel()

        await call(command_routes.take_gimbal("1", station, ANNA, 171, None))
        assert autopilot.gimbal_control == (0, 0), "control of the autopilot's gimbal was taken"
        assert second_gimbal.control_by_device[171] == (255, 190)
        angles = models.GimbalAngles(pitch_deg=-20, yaw_deg=5, wait=False)
        await call(command_routes.gimbal_angles("1", angles, station, ANNA, 171, 171))
        (command,) = second_gimbal.received_commands(GIMBAL_PITCHYAW)
        assert (command.param1, command.param7) == (-20, 171)
        assert {m.target_component for m in autopilot.received_commands(GIMBAL_PITCHYAW)} == {171}
        gimbal_view = await call(command_routes.show(vehicle, station, 171, None))
        assert (gimbal_view["in_control"], gimbal_view["gimbal"]["component_id"]) == (True, 171)
        assert not (await call(command_routes.show(vehicle, station, None, None)))["in_control"]
        with pytest.raises(InvalidRequest, match="no gimbal with component 7") as refused:
            await command_routes.take_gimbal("1", station, ANNA, 7, None)
        assert "component 1, device 1; component 171, device 171" in refused.value.remedy
        assert [line[1] for line in journal_entries(station)][-1] == "gimbal/take"

        await call_repeatedly(4, lambda: second_gimbal.send_attitude(Q_DOWN))
        value = vehicle.topic("gimbal").value
        assert (value.component_id, value.gimbals) == (171, ()), (
            "the first gimbal is still used after 3 s without its attitude"
        )

    run_with_vehicle(run_simulated, scenario, OffboardTestbed)


def test_two_devices_of_one_manager_are_distinguished(run_simulated):
    async def scenario(testbed, autopilot, vehicle):
        gimbals = OtherComponent(autopilot, 1, 2)
        autopilot.handlers.clear()

        def send_both_devices():
            for device, q in ((1, Q_LEVEL), (2, Q_HALF_DOWN)):
                gimbals.send_attitude(q, device)
                gimbals.send_status(device)

        gimbals.control_by_device = {1: (255, 190), 2: (255, 190)}
        autopilot.has_gimbal = False
        await call_repeatedly(2, send_both_devices)
        sending = asyncio.ensure_future(call_repeatedly(6, send_both_devices))
        autopilot.gimbal_control, autopilot.has_gimbal = (255, 190), True
        await vehicle.gimbals.service_for(1, 2).set_rates(1, 2)
        await vehicle.gimbal.set_rates(3, 4)
        sending.cancel()
        assert [(m.param3, m.param7) for m in autopilot.received_commands(GIMBAL_PITCHYAW)] == [
            (1, 2),
            (3, 1),
        ]
        assert [g.gimbal_device_id for g in vehicle.topic("gimbal").value.gimbals] == [1, 2]

    run_with_vehicle(run_simulated, scenario)


def test_no_component_replaces_the_autopilots_gimbal(run_simulated):
    async def scenario(testbed, autopilot, vehicle):
        impostor = OtherComponent(autopilot, 171, GIMBAL)
        impostor.control_by_device = {1: (42, 1)}

        def send_as_other_devices():
            for device in range(256):
                impostor.send_attitude(Q_DOWN, device)
                impostor.send_status(device)

        autopilot.send_gimbal_status()
        await call_repeatedly(1, send_as_other_devices)
        await call_repeatedly(
            1, autopilot.send_gimbal_attitude, autopilot.send_gimbal_status, send_as_other_devices
        )
        value = vehicle.topic("gimbal").value
        assert (value.component_id, value.gimbal_device_id, value.primary_control) == (1, 1, None)
        assert value.pitch_rad == pytest.approx(0.0, abs=1e-3)
        assert len(value.gimbals) <= 9
        taking = asyncio.ensure_future(vehicle.gimbal.take_control())
        await call_repeatedly(1, send_as_other_devices, autopilot.send_gimbal_attitude)
        await taking
        assert autopilot.gimbal_control == (255, 190)
        assert impostor.received_commands(GIMBAL_CONFIGURE) == []

    run_with_vehicle(run_simulated, scenario)


def test_a_picture_is_taken_by_the_connected_camera(run_simulated):
    async def scenario(testbed, autopilot, vehicle):
        first_camera, second_camera = (
            OtherComponent(autopilot, 100, CAMERA),
            OtherComponent(autopilot, 102, CAMERA),
        )
        await call_repeatedly(1, second_camera.send_heartbeat)
        await vehicle.service(CameraService).take_picture()
        assert picture_counts(first_camera, second_camera) == (0, 1)
        await call_repeatedly(1, first_camera.send_heartbeat, second_camera.send_heartbeat)
        await vehicle.service(CameraService).take_picture()
        assert picture_counts(first_camera, second_camera) == (1, 1)
        await call_repeatedly(LOST_AFTER_S + 1, second_camera.send_heartbeat)
        await vehicle.service(CameraService).take_picture()
        assert picture_counts(first_camera, second_camera) == (1, 2)

    run_with_vehicle(run_simulated, scenario)


def test_a_request_chooses_the_camera_by_its_component(run_simulated):
    async def scenario(testbed, autopilot, vehicle):
        first_camera, second_camera = (
            OtherComponent(autopilot, 100, CAMERA),
            OtherComponent(autopilot, 102, CAMERA),
        )
        await call_repeatedly(1, first_camera.send_heartbeat, second_camera.send_heartbeat)
        station = new_station(testbed)
        assert json_of(await command_routes.picture("1", station, ANNA, 102))["command"] == "camera/picture"
        await command_routes.picture("1", station, ANNA)
        assert picture_counts(first_camera, second_camera) == (1, 1)
        for wrong_id in (101, 1):  # no component has this id; the autopilot
            with pytest.raises(InvalidRequest, match=f"no connected camera with component id {wrong_id}"):
                await command_routes.picture("1", station, ANNA, wrong_id)
        await call_repeatedly(LOST_AFTER_S + 1, first_camera.send_heartbeat)
        with pytest.raises(InvalidRequest, match="no connected camera with component id 102"):
            await command_routes.picture("1", station, ANNA, 102)
        assert picture_counts(first_camera, second_camera) == (1, 1)

    run_with_vehicle(run_simulated, scenario, OffboardTestbed)


def test_the_error_about_a_missing_camera_names_the_requested_component(run_simulated):
    async def scenario(testbed, autopilot, vehicle):
        with pytest.raises(NoReply, match="No camera") as refused:
            await vehicle.service(CameraService).take_picture()
        assert "component 100" in refused.value.remedy

    run_with_vehicle(run_simulated, scenario)
