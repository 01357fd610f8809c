"""Typical programs of MAVSDK users, without pauses between commands, for MAVSDK 3 and 4.

`python -m tests.clients.mavsdk_programs NAME PORT FOLDER`: a program of `PROGRAMS`, the vehicle's TCP port on
this machine, and a folder for its files. Exit code 0, or a message about what did not happen.
"""

from __future__ import annotations

import asyncio
import math
import sys
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from tests.clients.any_mavsdk import Drone, connected

METRES_PER_DEGREE = 111_195.0
GRAVITY_M_S2 = 9.80665
SIDES = 6


def check(condition: object, what: str) -> None:
    """Ends the program with the message `what` unless `condition` is true."""
    if not condition:
        raise SystemExit(what)


async def next_value(stream: AsyncIterator[Any]) -> Any:
    """The next value of a stream."""
    async with asyncio.timeout(30.0):
        async for value in stream:
            return value
    raise SystemExit("the stream ended without a value")


async def request_mode(drone: Drone, request: Callable[[], Awaitable[None]], mode: str) -> None:
    """Requests a flight mode, up to three times.

    PX4 acknowledges DO_SET_MODE twice. MAVSDK mistakes the second acknowledgement for that of its next queued
    DO_SET_MODE, which it then never sends.
    """
    for within_s in (15.0, 15.0, 60.0):
        await request()
        with suppress(SystemExit):
            await drone.until("flight_mode", lambda value: value.name == mode, f"mode {mode}", within_s)
            return
    raise SystemExit(f"no mode {mode} after three requests")


async def go_to_before_lift_off_and_return_after_hold(drone: Drone, _: Path) -> None:
    """A go-to during the take-off is flown; a request for Return directly after one for Hold ends in
    Return."""
    home = await next_value(drone.stream("home"))
    lat_deg = home.latitude_deg + 40.0 / METRES_PER_DEGREE
    await drone.action.arm()
    await drone.action.takeoff()
    await drone.action.goto_location(lat_deg, home.longitude_deg, home.absolute_altitude_m + 10.0, 0.0)
    await drone.until(
        "position",
        lambda p: abs(p.latitude_deg - lat_deg) * METRES_PER_DEGREE < 2.0 and p.relative_altitude_m > 8.0,
        "arrival",
    )
    await drone.action.hold()
    await request_mode(drone, drone.action.return_to_launch, "RETURN_TO_LAUNCH")


async def mission_started_after_its_upload(drone: Drone, _: Path) -> None:
    """A mission is started directly after its upload to an armed vehicle."""
    home = await next_value(drone.stream("home"))
    lat, lon = round((home.latitude_deg + 8.0 / METRES_PER_DEGREE) * 1e7), round(home.longitude_deg * 1e7)
    item = drone.types("mission_raw").MissionItem
    relative, takeoff, waypoint, land = 6, 22, 16, 21
    plan = [
        item(seq, relative, command, int(seq == 0), 1, 0.0, 0.0, 0.0, math.nan, lat, lon, up_m, 0)
        for seq, (command, up_m) in enumerate(((takeoff, 4.0), (waypoint, 4.0), (land, 0.0)))
    ]
    await drone.action.arm()
    await drone.mission_raw.upload_mission(plan)
    await drone.mission_raw.start_mission()
    await drone.until("in_air", lambda in_air: in_air, "the take-off")
    await drone.until_disarmed()
    position = await next_value(drone.stream("position"))
    north_m = (position.latitude_deg - home.latitude_deg) * METRES_PER_DEGREE
    check(abs(north_m - 8.0) < 2.0, f"landed {north_m:.1f} m north of home instead of 8")


async def follow_a_target_at_a_safe_height(drone: Drone, _: Path) -> None:
    """The vehicle climbs before it moves horizontally, and stays above ground even if its target altitude is
    below ground."""
    types = drone.types("follow_me")
    home = await next_value(drone.stream("home"))
    await drone.telemetry.set_rate_ground_truth(10.0)
    ground_m = (await next_value(drone.stream("ground_truth"))).absolute_altitude_m
    lat_deg = home.latitude_deg + 60.0 / METRES_PER_DEGREE
    target_alt_m = home.absolute_altitude_m

    def config(height_m: float, mode: str) -> Any:
        return types.Config(height_m, 6.0, 0.1, types.Config.FollowAltitudeMode[mode], 8.0, 180.0)

    async def send_target() -> None:
        may_start_again = True
        while True:
            location = types.TargetLocation(lat_deg, home.longitude_deg, target_alt_m, 0.0, 0.0, 0.0)
            try:
                await drone.follow_me.set_target_location(location)
            except types.FollowMeError:  # a heartbeat from before the start makes MAVSDK stop following
                if not may_start_again:
                    raise
                may_start_again = False
                await drone.follow_me.start()
            await asyncio.sleep(0.2)

    await drone.follow_me.set_config(config(16.0, "CONSTANT"))
    await drone.action.set_takeoff_altitude(5.0)
    await drone.action.arm()
    await drone.action.takeoff()
    await drone.until("position", lambda p: p.relative_altitude_m > 4.5, "the take-off altitude")
    await drone.follow_me.start()
    await drone.until_mode("FOLLOW_ME")
    target_task = asyncio.ensure_future(send_target())
    low_positions: list[Any] = []

    def has_arrived(position: Any) -> bool:
        north_m = (position.latitude_deg - home.latitude_deg) * METRES_PER_DEGREE
        if north_m > 3.0 and position.relative_altitude_m < 12.0:
            low_positions.append(position)
        return north_m > 30.0

    await drone.until("position", has_arrived, "arrival near the target")
    check(
        not low_positions,
        f"the vehicle moved horizontally before it reached the altitude: {low_positions[:1]}",
    )

    # The requested altitude is 8 m above a target that is 30 m below the ground.
    target_alt_m = home.absolute_altitude_m - 30.0
    await drone.follow_me.set_config(config(8.0, "TARGET_GPS"))
    await drone.until("ground_truth", lambda t: t.absolute_altitude_m - ground_m < 2.5, "descent")
    lowest_m, samples = math.inf, 0
    async for truth in drone.stream("ground_truth"):
        lowest_m, samples = min(lowest_m, truth.absolute_altitude_m - ground_m), samples + 1
        if samples == 60:
            break
    check(lowest_m > 0.2, f"descended to {lowest_m:.2f} m above ground")
    check(await next_value(drone.stream("armed")), "landed and disarmed")
    target_task.cancel()


async def stick_input_with_gaps(drone: Drone, _: Path) -> None:
    """The program sends stick positions for half a second and none for half a second, again and again: the
    vehicle takes off and climbs."""
    sticks, is_sending = [0.0, 0.0, 0.0, 0.0], True

    async def pilot() -> None:
        while True:
            if is_sending:
                await drone.manual_control.set_manual_control_input(*sticks)
            await asyncio.sleep(0.03)

    # The failsafe that would react to each gap is disabled.
    await drone.param.set_param_int("NAV_RCL_ACT", 0)
    pilot_task = asyncio.ensure_future(pilot())
    await asyncio.sleep(0.5)
    await drone.manual_control.start_position_control()
    await drone.until_mode("POSCTL")
    await drone.action.arm()
    await asyncio.sleep(0.5)
    sticks[2] = 0.9
    alt_home_m = 0.0
    for _gap in range(40):
        is_sending = True
        await asyncio.sleep(0.5)
        is_sending = False
        await asyncio.sleep(0.5)
        alt_home_m = (await next_value(drone.stream("position"))).relative_altitude_m
        if alt_home_m > 3.0:
            break
    check(alt_home_m > 3.0, f"after forty throttle inputs the vehicle is {alt_home_m:.1f} m above home")
    pilot_task.cancel()


async def files_in_ten_rounds(drone: Drone, folder: Path) -> None:
    """Ten times: creates a directory, uploads a file, and downloads it with or without burst. No FTP session
    stays open."""
    ftp = drone.ftp

    async def read_to_end(steps: AsyncIterator[Any]) -> None:
        async with asyncio.timeout(30.0):
            async for _ in steps:
                pass

    async def download(downloaded: Path, burst: bool) -> None:
        for attempts_left in (2, 1, 0):
            try:
                return await read_to_end(ftp.download("/round/note.txt", str(downloaded), burst))
            except Exception as error:
                # If a reply takes half a second, MAVSDK 3 opens the file again with another sequence number
                # while the only session is in use. Then MAVSDK closes the session and reports an error; a
                # retry succeeds.
                if "PROTOCOL_ERROR" not in str(error) or not attempts_left:
                    raise

    for round_number in range(10):
        sent_file = folder / "note.txt"
        sent_file.write_bytes(bytes((round_number + k) % 251 for k in range(1200)))
        await ftp.create_directory("/round")
        await read_to_end(ftp.upload(str(sent_file), "/round"))
        check(await ftp.are_files_identical(str(sent_file), "/round/note.txt"), "the uploaded file differs")
        downloaded = folder / f"back{round_number}"
        downloaded.mkdir()
        await download(downloaded, bool(round_number % 2))
        check((downloaded / "note.txt").read_bytes() == sent_file.read_bytes(), "the downloaded file differs")
        listing = await ftp.list_directory("/round")
        entries = getattr(listing, "entries" if drone.version == 4 else "files")
        check(len(entries) == 1, f"the directory lists {entries} instead of one file")
        await ftp.remove_file("/round/note.txt")
        await ftp.remove_directory("/round")


async def accelerometer_calibrated_on_all_sides(drone: Drone, _: Path) -> None:
    """The vehicle requests one side after the other and measures the mean acceleration on each."""
    texts: list[str] = []

    async def listen() -> None:
        async for message in drone.stream("status_text"):
            texts.append(message.text)

    listener = asyncio.ensure_future(listen())
    instructions, progress = list[str](), 0.0
    async with asyncio.timeout(150.0):
        async for step in drone.calibration.calibrate_accelerometer():
            data = step[1] if isinstance(step, tuple) else step
            if data.has_status_text:
                instructions.append(data.status_text)
            if data.has_progress:
                progress = max(progress, data.progress)
    listener.cancel()
    check(progress > 0.8, f"progress ended at {progress:.2f}")
    finished = {text for text in instructions if "side done" in text}
    check(len(finished) == SIDES, f"the vehicle did not finish {SIDES} sides: {finished}")
    results = [text for text in texts if "side result" in text]
    check(len(results) == SIDES, f"the vehicle did not report {SIDES} measurements: {results}")
    for text in results:
        reading = [abs(float(word)) for word in text.rsplit("[", 1)[1].rstrip("] \t").split()]
        error = max(
            abs(value - expected)
            for value, expected in zip(sorted(reading), (0.0, 0.0, GRAVITY_M_S2), strict=True)
        )
        check(error < 0.05, f"the measurement differs from gravity by {error:.2f} m/s²: {text}")


PROGRAMS: dict[str, Callable[[Drone, Path], Awaitable[None]]] = {
    program.__name__: program
    for program in (
        go_to_before_lift_off_and_return_after_hold,
        mission_started_after_its_upload,
        follow_a_target_at_a_safe_height,
        stick_input_with_gaps,
        files_in_ten_rounds,
        accelerometer_calibrated_on_all_sides,
    )
}


async def run(name: str, port: int, folder: Path) -> None:
    """Connects and runs a program to its end."""
    async with connected(port) as drone:
        await PROGRAMS[name](drone, folder)


if __name__ == "__main__":
    asyncio.run(run(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3])))
