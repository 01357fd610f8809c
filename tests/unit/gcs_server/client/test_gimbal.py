"""The gimbal calls of the client."""

import asyncio

from gcs_server.client.vehicle import Gimbal

REACHED_LIMIT = {"pitch_deg": -45.0, "asked_pitch_deg": -90.0, "text": "The gimbal stopped at its own limit."}


class FakeVehicle:
    def __init__(self, limited):
        self.limited, self.requests = limited, []

    async def request(self, method, path="", body=None):
        self.requests.append((method, path, body))
        return {"command": "gimbal/angles", "limited": self.limited}


def test_the_angles_call_returns_the_limit_at_which_the_gimbal_stopped():
    for limited in (None, REACHED_LIMIT):
        vehicle = FakeVehicle(limited)
        assert asyncio.run(Gimbal(vehicle).angles(-90, 0)) == limited
        assert vehicle.requests == [
            ("POST", "/gimbal/angles", {"pitch_deg": -90, "yaw_deg": 0, "yaw_lock": False})
        ]
