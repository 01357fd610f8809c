"""Two published ROS 2 programs, ported to plain DDS, fly the simulator in simulated time."""

from __future__ import annotations

import os

import pytest

from tests.clients import ros2_flow, ros2_offboard_node
from tests.clients.px4_dds import Node, VehicleLocalPosition
from tests.clients.ros2_offboard_node import POSITION_TOPICS
from tests.support.ros2_vehicle import NO_TIME_SYNC
from vehicle_sim.dds.participant import DdsDomain
from vehicle_sim.fleet import SimulatedFleet
from vehicle_sim.px4_version import V1_17, VERSIONS, Px4Version

pytestmark = pytest.mark.flight
DOMAIN = 47


class Flight:
    """A vehicle on DDS; records its altitude above the start."""

    def __init__(self, domain: DdsDomain, namespace: str, px4: Px4Version) -> None:
        self.sim = SimulatedFleet(
            1, links=(), sensor_noise=False, parameters=NO_TIME_SYNC | {"UXRCE_DDS_SYNCT": 1}, px4=px4
        )
        self.sim.open_ros2(0, domain.open(namespace, px4), lambda text: None)
        self.sim.step(6.0)
        self.heights_m: list[float] = []

    def sleep(self, seconds: float) -> None:
        """Replaces the program's sleep: simulates this time, and records the height."""
        self.sim.step(seconds)
        self.heights_m.append(-self.sim.autopilots[0].view.estimate.position_ned_m[2])

    def first_above_s(self, height_m: float) -> float:
        """Time from the program start until the vehicle was above this height; a sleep takes 0.1 s."""
        return 0.1 * next(step for step, height in enumerate(self.heights_m, start=1) if height > height_m)

    def lands_and_disarms(self) -> bool:
        """Whether the vehicle lands and disarms within 25 s."""
        for _ in range(25):
            self.sim.step(1.0)
            if not self.sim.autopilots[0].commander.armed:
                return True
        return False


@pytest.fixture(scope="module")
def domain() -> DdsDomain:
    return DdsDomain(DOMAIN)


@pytest.mark.story
@pytest.mark.parametrize("px4", VERSIONS)
def test_the_offboard_node_climbs_to_five_metres_and_lands(domain, capsys, px4):
    namespace = f"node_{os.getpid()}_{px4[-2:]}"
    flight = Flight(domain, namespace, VERSIONS[px4])
    ros2_offboard_node.main(DOMAIN, namespace, flight.sleep, POSITION_TOPICS[px4])
    assert "Switching to land mode" in capsys.readouterr().out
    # PX4 lifted off 4.3 s after the first message in a recording, and passed 4.5 m after 7.4 to 7.6 s.
    assert flight.first_above_s(0.1) - 0.4 == pytest.approx(4.3, abs=0.5)
    assert flight.first_above_s(4.5) - 0.4 == pytest.approx(7.4, abs=0.7)
    assert flight.heights_m[-1] == pytest.approx(5.0, abs=0.1)
    assert flight.lands_and_disarms()


def test_a_program_for_v1_16_receives_no_position_from_v1_17(domain):
    namespace = f"old_{os.getpid()}"
    node = Node(DOMAIN, namespace)
    positions = {
        px4: node.subscription(VehicleLocalPosition, topic) for px4, topic in POSITION_TOPICS.items()
    }
    Flight(domain, namespace, V1_17).sleep(1.0)
    assert positions["1.16"].latest is None
    assert positions["1.17"].latest.z_valid


@pytest.mark.story
@pytest.mark.parametrize("px4", VERSIONS)
def test_the_flow_keeps_an_altitude_of_one_metre_for_twenty_seconds_and_lands(domain, px4):
    namespace = f"flow_{os.getpid()}_{px4[-2:]}"
    flight = Flight(domain, namespace, VERSIONS[px4])
    ros2_flow.main(DOMAIN, namespace, flight.sleep)
    assert max(flight.heights_m) < 1.3
    assert all(abs(height - 1.0) < 0.2 for height in flight.heights_m[-100:])
    assert flight.lands_and_disarms()
