"""Two published ROS 2 programs, ported to plain DDS, fly the simulator in simulated time."""

from __future__ import annotations

import os

import pytest

from tests.clients import ros2_flow, ros2_offboard_node
from tests.support.ros2_vehicle import NO_TIME_SYNC
from vehicle_sim.dds.participant import DdsDomain
from vehicle_sim.fleet import SimulatedFleet

pytestmark = pytest.mark.flight
DOMAIN = 47


class Flight:
    """A vehicle on DDS; records its altitude above the start."""

    def __init__(self, domain: DdsDomain, namespace: str) -> None:
        self.sim = SimulatedFleet(
            1, links=(), sensor_noise=False, parameters=NO_TIME_SYNC | {"UXRCE_DDS_SYNCT": 1}
        )
        self.sim.open_ros2(0, domain.open(namespace), lambda text: None)
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
def test_the_offboard_node_climbs_to_five_metres_and_lands(domain, capsys):
    namespace = f"node_{os.getpid()}"
    flight = Flight(domain, namespace)
    ros2_offboard_node.main(DOMAIN, namespace, flight.sleep)
    assert "Switching to land mode" in capsys.readouterr().out
    # PX4 lifted off 4.3 s after the first message in a recording, and passed 4.5 m after 7.4 to 7.6 s.
    assert flight.first_above_s(0.1) - 0.4 == pytest.approx(4.3, abs=0.5)
    assert flight.first_above_s(4.5) - 0.4 == pytest.approx(7.4, abs=0.7)
    assert flight.heights_m[-1] == pytest.approx(5.0, abs=0.1)
    assert flight.lands_and_disarms()


@pytest.mark.story
def test_the_flow_keeps_an_altitude_of_one_metre_for_twenty_seconds_and_lands(domain):
    namespace = f"flow_{os.getpid()}"
    flight = Flight(domain, namespace)
    ros2_flow.main(DOMAIN, namespace, flight.sleep)
    assert max(flight.heights_m) < 1.3
    assert all(abs(height - 1.0) < 0.2 for height in flight.heights_m[-100:])
    assert flight.lands_and_disarms()
