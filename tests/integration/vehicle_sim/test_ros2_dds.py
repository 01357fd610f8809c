"""The simulator's topics on real DDS. Within one process DDS delivers at once, so the tests use simulated
time."""

# No `from __future__ import annotations`: Cyclone evaluates the annotations of message types.
import gc
import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float32, float64, uint8, uint16, uint32, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic

from tests.support.ros2_vehicle import NO_TIME_SYNC
from vehicle_sim.dds.participant import DdsDomain, DdsUnavailable, configuration
from vehicle_sim.dds.types import idl_dataclass
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.px4_version import V1_16, VERSIONS
from vehicle_sim.ros2.messages import MESSAGES
from vehicle_sim.ros2.topics import dds_name, topics_of

DOMAIN = 48
NAMESPACE = f"test_{os.getpid()}"
"""Unique, since tests that run at the same time share the loopback interface."""
BEST_EFFORT = Qos(Policy.Reliability.BestEffort, Policy.Durability.TransientLocal, Policy.History.KeepLast(5))
ARM_DISARM, ARMED = 400, 2
RELIABLE = Qos(Policy.Reliability.Reliable(0), Policy.History.KeepLast(5))


@dataclass
class VehicleCommand(IdlStruct, typename="px4_msgs.msg.dds_.VehicleCommand_"):
    """A hand-written message type, as in a user's program."""

    timestamp: uint64 = 0
    param1: float32 = 0.0
    param2: float32 = 0.0
    param3: float32 = 0.0
    param4: float32 = 0.0
    param5: float64 = 0.0
    param6: float64 = 0.0
    param7: float32 = 0.0
    command: uint32 = 0
    target_system: uint8 = 1
    target_component: uint8 = 1
    source_system: uint8 = 1
    source_component: uint16 = 1
    confirmation: uint8 = 0
    from_external: bool = True


@pytest.fixture(scope="module")
def domain() -> DdsDomain:
    return DdsDomain(DOMAIN)


@pytest.fixture
def vehicle(domain) -> Iterator[SimulatedFleet]:
    sim = SimulatedFleet(1, links=(), sensor_noise=False, parameters=NO_TIME_SYNC)
    sim.open_ros2(0, domain.open(NAMESPACE), lambda text: None)
    sim.step(4.0)
    yield sim
    sim.close()


def _reader(name: str, message: str, qos: Qos = BEST_EFFORT) -> Any:
    participant = DomainParticipant(DOMAIN)
    topic = Topic(participant, dds_name(name, NAMESPACE), idl_dataclass(MESSAGES["1.16"][message]))
    return DataReader(participant, topic, qos=qos)


@pytest.mark.parametrize("qos", [BEST_EFFORT, RELIABLE], ids=["best effort", "reliable"])
def test_a_command_of_a_plain_dds_program_arms_the_vehicle(vehicle, qos):
    participant = DomainParticipant(DOMAIN)
    topic = Topic(participant, dds_name("/fmu/in/vehicle_command", NAMESPACE), VehicleCommand)
    ack_reader = _reader("/fmu/out/vehicle_command_ack", "VehicleCommandAck")
    status_reader = _reader("/fmu/out/vehicle_status_v1", "VehicleStatus")
    DataWriter(participant, topic, qos=qos).write(VehicleCommand(command=ARM_DISARM, param1=1.0))
    vehicle.step(0.04)
    (ack,) = ack_reader.take(5)
    assert (ack.command, ack.result, ack.target_system) == (ARM_DISARM, 0, 1)
    assert status_reader.take(5)[-1].arming_state == ARMED


def test_a_reliable_reader_receives_nothing_and_a_best_effort_reader_every_attitude(vehicle):
    reliable_reader = _reader("/fmu/out/vehicle_attitude", "VehicleAttitude", RELIABLE)
    best_effort_reader = _reader("/fmu/out/vehicle_attitude", "VehicleAttitude")
    vehicle.step(0.05)
    assert reliable_reader.take(9) == []
    assert len(best_effort_reader.take(9)) >= 4


@pytest.mark.parametrize(("px4", "written", "read"), [("1.16", 25, 28), ("1.17", 28, 39)])
def test_there_is_a_writer_or_reader_for_each_topic(domain, px4, written, read):
    topics = topics_of(VERSIONS[px4])
    for topic in (*topics.outputs, *topics.inputs):
        assert idl_dataclass(topic.message).__idl__.idl_transformed_typename.endswith(f"::{topic.type}_")
    port = domain.open(f"{NAMESPACE}_{px4[-2:]}", VERSIONS[px4])
    assert len(port._writers) == written
    assert len(port._readers) == read


def test_a_program_with_the_types_of_v1_17_reads_a_vehicle_of_v1_17_beside_one_of_v1_16(domain, vehicle):
    namespace = f"{NAMESPACE}_old"
    old = SimulatedFleet(1, links=(), sensor_noise=False, parameters=NO_TIME_SYNC, px4=V1_16)
    old.open_ros2(0, domain.open(namespace, V1_16), lambda text: None)
    participant = DomainParticipant(DOMAIN)
    readers: list[Any] = []
    for px4, name in (("1.16", namespace), ("1.17", NAMESPACE)):
        message = idl_dataclass(MESSAGES[px4]["FailsafeFlags"])
        topic = Topic(participant, dds_name("/fmu/out/failsafe_flags", name), message)
        readers.append(DataReader(participant, topic, qos=BEST_EFFORT))
    old.step(4.0)
    vehicle.step(1.0)
    old_flags, new_flags = (reader.take(9)[-1] for reader in readers)
    assert old_flags.manual_control_signal_lost
    assert new_flags.manual_control_signal_lost
    assert not old_flags.geofence_breached
    assert not new_flags.geofence_breached
    assert not new_flags.global_position_invalid_relaxed
    old.close()


def test_only_the_newest_messages_of_a_flooding_writer_are_received(vehicle):
    participant = DomainParticipant(DOMAIN)
    topic = Topic(participant, dds_name("/fmu/in/vehicle_command", NAMESPACE), VehicleCommand)
    writer = DataWriter(participant, topic, qos=BEST_EFFORT)
    for number in range(5000):
        writer.write(VehicleCommand(command=30_000 + number))
    received = vehicle._bridges[0]._port.take()
    assert len(received) == 2 * MESSAGES["1.16"]["VehicleCommand"].constants["ORB_QUEUE_LENGTH"]


def test_a_vehicle_keeps_its_domain_open():
    port = DdsDomain(DOMAIN + 1).open(NAMESPACE)
    gc.collect()
    assert port.take() == []


def test_a_vehicle_executes_the_last_command_of_a_program_that_has_ended(vehicle):
    participant = DomainParticipant(DOMAIN)
    topic = Topic(participant, dds_name("/fmu/in/vehicle_command", NAMESPACE), VehicleCommand)
    writer = DataWriter(participant, topic, qos=RELIABLE)
    writer.write(VehicleCommand(command=ARM_DISARM, param1=1.0))
    writer.dispose(VehicleCommand())
    del writer, topic, participant
    vehicle.step(0.1)
    assert vehicle.autopilots[0].commander.armed


def test_without_an_interface_dds_uses_only_the_loopback_interface(monkeypatch):
    monkeypatch.setenv("CYCLONEDDS_URI", "<CycloneDDS><Domain id='any'/></CycloneDDS>")
    default_configuration, eth0_configuration = configuration(None), configuration("eth0")
    assert 'name="lo"' in default_configuration
    assert "<AllowMulticast>false</AllowMulticast>" in default_configuration
    assert 'name="eth0"' in eth0_configuration
    assert "AllowMulticast" not in eth0_configuration
    assert 'name="lo"' not in eth0_configuration


def test_the_error_about_a_missing_interface_names_the_interface():
    with pytest.raises(DdsUnavailable, match="no-such-interface"):
        DdsDomain(DOMAIN + 1, "no-such-interface")
