"""No port of a simulated vehicle is the destination of another one, however many there are."""

from vehicle_sim.server import Ports

VEHICLES = 500


def test_each_vehicle_has_ports_of_its_own_and_none_sends_to_a_vehicle_or_to_the_ground_stations_port():
    ports = Ports()
    local = [port + n for port in (ports.gcs_local, ports.api_local) for n in range(VEHICLES)]
    remote = [ports.api_remote_of(n) for n in range(VEHICLES)]
    assert len(set(local)) == len(local)
    assert not {*remote, ports.gcs_remote} & set(local)
    assert ports.gcs_remote not in remote
    assert remote[:11] == [*range(14540, 14550), 14549]
