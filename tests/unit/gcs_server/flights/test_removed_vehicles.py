"""A vehicle removed while something waits is not put back, and a fault of one does not stop the others."""

import asyncio
import logging
from types import SimpleNamespace

import pytest

from gcs_server.control.authority import Authority
from gcs_server.errors import GcsError, UnknownVehicle
from gcs_server.faults import Isolation
from gcs_server.flights import mission_modes
from gcs_server.flights.mission_modes import MissionModes
from gcs_server.flights.mission_values import MissionAsMode, MissionName
from gcs_server.links.base import DdsAddress
from gcs_server.ros2.external_mode import Registration
from gcs_server.supervise import Supervisor


class Clock:
    """A clock that advances only when something sleeps."""

    def __init__(self):
        self.now_s = 100.0

    def monotonic_s(self):
        return self.now_s

    def unix_s(self):
        return 1e9 + self.now_s

    async def sleep(self, seconds):
        self.now_s += seconds
        await asyncio.sleep(0)


class Vehicle(SimpleNamespace):
    """A vehicle that is reached over ROS 2."""

    def __init__(self, vehicle_id, clock):
        super().__init__(
            id=vehicle_id,
            endpoints=(),
            isolation=Isolation(clock, logging.getLogger("test"), vehicle_id),
            mode_cause=None,
            status=SimpleNamespace(mode="hold", armed=False, link_lost=True),
            mode_names=SimpleNamespace(external={}),
        )

    def require_commandable(self):
        pass


class ModesSetup:
    """The mission modes of vehicles "1" and "2"; `at_register` is called while PX4 registers a mode."""

    def __init__(self, monkeypatch):
        monkeypatch.setattr(mission_modes, "dds_address", lambda _endpoints: DdsAddress(0, None, ""))
        monkeypatch.setattr(mission_modes, "_require_topics", lambda _vehicle, _topics: None)
        self.clock = Clock()
        self.vehicles = {i: Vehicle(i, self.clock) for i in ("1", "2")}
        self.at_register = lambda _vehicle_id: None
        self.states, self.unregistered = {}, []
        streams = SimpleNamespace(
            register_mode=self.register_mode,
            unregister_mode=lambda vehicle_id, _name: self.unregistered.append(vehicle_id),
            modes=lambda: self.states,
        )
        streamer = SimpleNamespace(offboard=self.offboard)
        self.modes = MissionModes(
            self.clock,
            streamer,
            streams,
            SimpleNamespace(),
            Supervisor(self.clock),
            SimpleNamespace(prepare=self.prepare, inputs=lambda _: None),
        )

    async def prepare(self, _vehicle_id, _mode):
        return SimpleNamespace(timeline=SimpleNamespace(needs=(), segments=()))

    def offboard(self, vehicle_id):
        if vehicle_id not in self.vehicles:
            raise UnknownVehicle(vehicle_id, sorted(self.vehicles))
        return SimpleNamespace(vehicle=self.vehicles[vehicle_id], require_topics=lambda *_, **__: None)

    async def register_mode(self, vehicle_id, _address, declaration):
        self.states[vehicle_id] = (Registration(declaration.name, "registering", None, ""),)
        await asyncio.sleep(0)
        self.at_register(vehicle_id)

    def remove(self, vehicle_id):
        self.modes.detach(self.vehicles.pop(vehicle_id))

    async def register(self, vehicle_id):
        mode = MissionAsMode("Show", MissionName("Show", None, None), "", (), "anna")
        return await self.modes.register(vehicle_id, mode)


@pytest.fixture
def setup(monkeypatch):
    return ModesSetup(monkeypatch)


def test_a_vehicle_removed_while_its_mode_is_registered_does_not_end_the_updates_of_all(setup):
    setup.at_register = setup.remove
    with pytest.raises(GcsError):
        asyncio.run(setup.register("1"))
    assert setup.unregistered == ["1"]
    setup.modes.update()
    assert setup.modes.all("1") == []


def test_a_vehicle_replaced_while_its_mode_is_registered_gets_no_mode(setup):
    def replace(vehicle_id):
        setup.remove(vehicle_id)
        setup.vehicles[vehicle_id] = Vehicle(vehicle_id, setup.clock)

    setup.at_register = replace
    with pytest.raises(UnknownVehicle):
        asyncio.run(setup.register("1"))
    assert setup.modes.all("1") == []


def test_a_vehicle_removed_while_px4_answers_ends_only_its_registration(setup):
    async def remove_soon():
        for _ in range(5):
            await asyncio.sleep(0)
        setup.remove("1")
        setup.states.clear()

    async def scenario():
        return await asyncio.gather(setup.register("1"), remove_soon(), return_exceptions=True)

    error, _ = asyncio.run(scenario())
    assert isinstance(error, GcsError)
    setup.modes.update()


def test_a_lease_that_fails_does_not_keep_the_others_from_expiring():
    clock, ended = Clock(), []
    fleet = SimpleNamespace(on_vehicle_added=lambda _: None, on_vehicle_removed=lambda _: None)
    authority = Authority(clock, fleet, SimpleNamespace(), Supervisor(clock))
    for vehicle_id, expire in (("1", lambda: 1 / 0), ("2", lambda: ended.append("2"))):
        lease = SimpleNamespace(expire_due=expire)
        vehicle = Vehicle(vehicle_id, clock)
        authority._controls[vehicle_id] = SimpleNamespace(vehicle=vehicle, lease=lease)
    authority._expire_due()
    assert ended == ["2"]
