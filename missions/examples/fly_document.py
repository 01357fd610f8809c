"""Common code of the offboard mission examples: flies a mission and prints the progress."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

from gcs_server.client import Gcs, Vehicle
from missions.examples.arguments import parse
from missions.offboard.document import OffboardMission, write

ENDED_STATES = ("done", "aborted", "stopped", "suspended")


async def fly(
    server: str, vehicle: str | None, mission: str | OffboardMission, *, yes: bool, client: str
) -> None:
    """Waits until the vehicle is ready, flies the mission, and returns once the vehicle is disarmed.

    Args:
        server: address of the ground station.
        vehicle: id of the vehicle; None: the first connected one.
        mission: the mission, or the name of a file in this folder.
        yes: continue at each question of the mission without waiting for the Enter key.
        client: name of this program, shown to other clients.

    Raises:
        SystemExit: the mission ended early.
    """
    async with Gcs(server, client=client) as gcs:
        drone = await gcs.wait_for_vehicle(vehicle, ready=True)
        if isinstance(mission, str):
            text = (Path(__file__).parent / mission).read_bytes()
            document = (await gcs.plans().read_file(text, mission))["plan"]
        else:
            document = json.loads(write(mission))
        started = await drone.offboard_mission.start(document)
        print(f"{started['name']}: about {started['duration_s']:.0f} s. {started['if_stream_stops']}")
        ended = await follow(drone, yes=yes)
        if ended["state"] != "done":
            raise SystemExit(f"The mission is {ended['state']}: {ended['reason']}")
        await drone.until_disarmed()
    print("Landed and disarmed.")


async def follow(drone: Vehicle, *, yes: bool) -> dict[str, Any]:
    """Prints each new step, asks the mission's questions on the terminal, and returns its final state."""
    printed_step = None
    while True:
        state = await drone.offboard_mission.state()
        assert state is not None
        if state["state"] in ENDED_STATES:
            return state
        if state["place"] is not None and (state["place"], state["title"]) != printed_step:
            printed_step = (state["place"], state["title"])
            print(f"{state['place']}: {state['title']}, {state['remaining_s']:.0f} s left")
        if state["question"] is not None:
            if yes:
                print(f"{state['question']} Yes.")
            else:
                await asyncio.to_thread(input, f"{state['question']} Press Enter: ")
            await drone.offboard_mission.go_on()
        await asyncio.sleep(0.5)


def main(description: str, mission: str | OffboardMission, client: str) -> None:
    """Entry point of an example."""
    arguments = parse(description, yes="answer each question of the mission with yes")
    asyncio.run(fly(arguments.server, arguments.vehicle, mission, yes=arguments.yes, client=client))
