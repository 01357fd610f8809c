"""`make screenshots`: takes pictures of the page in each state, light and dark, for docs/images.

It starts a server and simulated vehicles, and flies the vehicles so that the page shows each state. At the
end it lists the states that failed. `--only offboard,connection_lost` takes only pictures of these states.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import sys
import tempfile
from collections.abc import Callable, Generator
from pathlib import Path

from gcs_server.client import SyncGcs, SyncVehicle
from tests.e2e import plan_pictures
from tests.e2e.browser import REPOSITORY, bounding_box, chromium, client_id_script, confirm_by_space_bar
from tests.e2e.fast_station import FAST_OPTIONS
from tests.e2e.line_mission import plan_at, start_mission
from tests.e2e.pictures import (
    CLIENT_ID,
    DESKTOP_SIZE,
    PHONE_SIZE,
    TABLET_SIZE,
    THEMES,
    PictureSetup,
    save_in_both_themes,
    save_picture,
    wait_for_state_text,
    wait_until_unchanged,
)
from tests.station import free_port, running_server, running_vehicles
from tests.support.flown_log import flown_log
from tools import build_page

IMAGES = REPOSITORY / "docs" / "images"


def flight_to_position(setup: PictureSetup) -> None:
    """The vehicle flies to a position, with a trail behind it."""
    home = setup.drone.topic("home")
    assert home is not None
    setup.drone.goto(home["lat_deg"] + 0.00028, home["lon_deg"] + 0.00035, alt_home_m=14)
    setup.drone.until(
        lambda v: (v["topics"]["hud"]["value"]["groundspeed_m_s"] or 0) > 4, what="a speed of 4 m/s"
    )
    wait_until_unchanged(setup.page, 2)
    save_in_both_themes(setup.page, setup.folder, "fly")


def map_menu(setup: PictureSetup) -> None:
    """The large map with the menu for a clicked position."""
    page = setup.page
    page.keyboard.press("m")
    page.get_by_role("toolbar", name="Map").wait_for()
    wait_until_unchanged(page, 3)
    page.mouse.click(DESKTOP_SIZE[0] * 0.5, DESKTOP_SIZE[1] * 0.34)
    page.get_by_role("dialog").wait_for()
    save_in_both_themes(page, setup.folder, "map")
    page.keyboard.press("Escape")
    page.keyboard.press("m")


def return_confirmation(setup: PictureSetup) -> None:
    """The confirmation of Return."""
    save_in_both_themes(setup.page, setup.folder, "confirm", lambda: setup.page.keyboard.press("r"))
    setup.page.keyboard.press("Escape")


def panels(setup: PictureSetup) -> None:
    """The mode menu, an orbit in the guide, the vehicle's console, and the map sources."""
    page = setup.page
    for name, key in (("modes", "Shift+M"), ("guide", "b"), ("console", "s"), ("map-source", "Shift+F")):
        page.keyboard.press(key)
        if name == "guide":
            page.get_by_label("Guide", exact=True).get_by_role("radio", name="Orbit", exact=True).click()
        if name == "console":
            page.get_by_label("Send while").check()
            page.get_by_label("Line to send").fill("gimbal status")
            page.get_by_label("Line to send").press("Enter")
        wait_until_unchanged(page, 3)
        save_in_both_themes(page, setup.folder, name)
        page.keyboard.press("Escape")


def new_rooms(setup: PictureSetup) -> None:
    """The search, the set-up of the gimbal, the gamepad, and a log of a flight."""
    page = setup.page
    page.keyboard.press("Control+k")
    page.get_by_role("combobox").fill("return")
    save_in_both_themes(page, setup.folder, "search")
    page.keyboard.press("Escape")
    page.keyboard.press("Shift+V")
    page.get_by_role("region", name="Vehicle set-up").wait_for()
    wait_until_unchanged(page, 3)
    save_in_both_themes(page, setup.folder, "vehicle")
    page.keyboard.press("Shift+V")
    page.keyboard.press("Shift+U")
    settings = page.get_by_role("region", name="Settings", exact=True)
    settings.get_by_role("radio", name="Gamepad", exact=True).click()
    wait_until_unchanged(page, 3)
    save_in_both_themes(page, setup.folder, "settings")
    page.keyboard.press("Shift+U")
    with tempfile.TemporaryDirectory() as folder:
        log, _ = flown_log(Path(folder), (0.0, 3.0, 0.0))
        page.keyboard.press("Shift+E")
        page.get_by_label("Add a log").set_input_files(log)
        page.get_by_role("radio", name="Fields", exact=True).click()
        page.get_by_role("button", name="Position", exact=True).click()
        wait_until_unchanged(page, 3)
        save_in_both_themes(page, setup.folder, "flights")
        page.keyboard.press("Shift+E")


def mission_in_flight(setup: PictureSetup) -> None:
    """A waypoint plan in flight on the map: numbered items, the flown part faded, the mission's card."""
    page, drone = setup.page, setup.drone
    drone.mission.upload(plan_at(drone))
    page.keyboard.press("m")
    start_mission(drone)
    page.get_by_label("Mission", exact=True).wait_for()
    page.keyboard.press("z")
    drone.until(lambda v: (v["topics"]["mission"]["value"]["current"] or 0) >= 2, what="the second waypoint")
    save_in_both_themes(page, setup.folder, "mission-flight")
    page.keyboard.press("h")
    wait_for_state_text(page, "Holding")
    page.keyboard.press("m")


def offboard(setup: PictureSetup) -> None:
    """A setpoint stream whose target is north-east of the vehicle."""
    page = setup.page
    page.keyboard.press("o")
    confirm_by_space_bar(page)
    wait_for_state_text(page, "Offboard")
    card = page.get_by_label("Offboard", exact=True)
    card.get_by_role("radio", name="5 m", exact=True).click()

    def move_target() -> None:
        card.get_by_role("button", name="5 m north").click()
        card.get_by_role("button", name="5 m east").click()

    save_in_both_themes(page, setup.folder, "offboard", move_target)
    page.keyboard.press("h")
    wait_for_state_text(page, "Holding")


def setpoint_form(setup: PictureSetup) -> None:
    """The form of the offboard view: the streamed setpoint, the vehicle's values, and a preview."""
    page = setup.page
    page.keyboard.press("m")
    page.keyboard.press("p")
    view = page.get_by_role("region", name="Offboard view")
    north, east, up = (view.get_by_label(f"Position, {axis}") for axis in ("North", "East", "Up"))
    north.fill("12")
    east.fill("6")
    up.fill("12")
    view.get_by_role("button", name="Start…").click()
    confirm_by_space_bar(page)
    wait_for_state_text(page, "Offboard")
    wait_until_unchanged(page, 4)
    north.fill("2")
    east.fill("14")
    up.fill("10")
    view.get_by_role("button", name="Send").click()
    wait_until_unchanged(page, 5)
    north.fill("16")
    east.fill("4")
    up.fill("14")
    save_in_both_themes(page, setup.folder, "room")
    page.keyboard.press("Tab")
    view.get_by_role("button", name="Hold", exact=True).click()
    page.get_by_role("button", name="Close the offboard view").click()
    page.keyboard.press("m")


def drag_in_3d(setup: PictureSetup) -> None:
    """A position that was set by handles in 3D and is not sent yet."""
    page = setup.page
    wait_for_state_text(page, "Holding")
    page.keyboard.press("p")
    view = page.get_by_role("region", name="Offboard view")
    view.get_by_role("radio", name="Drag in 3D").click()
    view.get_by_role("button", name="Reset target to vehicle").click()
    for name in ("1 m south", "1 m east", "15° right", "15° right"):
        view.get_by_role("button", name=name).click()
    wait_until_unchanged(page, 5)
    save_in_both_themes(page, setup.folder, "drag")
    page.get_by_role("button", name="Close the offboard view").click()


def gimbal(setup: PictureSetup) -> None:
    """The panel that points the camera."""
    page = setup.page
    card = page.get_by_label("Gimbal", exact=True)
    card.scroll_into_view_if_needed()
    card.get_by_role("button", name="Take").click()
    card.get_by_role("button", name="Release").wait_for()
    box = bounding_box(card.locator("svg.enabled"))
    page.mouse.click(box["x"] + box["width"] * 0.62, box["y"] + box["height"] * 0.6)
    save_in_both_themes(page, setup.folder, "gimbal")


def refused_disarming(setup: PictureSetup) -> None:
    """The vehicle refuses to disarm in flight, with the reason."""
    page = setup.page
    page.keyboard.press("Shift+A")
    confirm_by_space_bar(page)
    page.locator(".place").get_by_role("alert").wait_for()
    save_in_both_themes(page, setup.folder, "refused")
    page.keyboard.press("Escape")


def small_screens(setup: PictureSetup) -> None:
    """The layouts for a tablet and a phone."""
    setup.page.goto("about:blank")  # two 3D views at once are too slow in software
    for name, (width, height) in (("tablet", TABLET_SIZE), ("phone", PHONE_SIZE)):
        for theme in THEMES:
            context = setup.browser.new_context(
                viewport={"width": width, "height": height}, has_touch=True, color_scheme=theme
            )
            page = context.new_page()
            page.add_init_script(client_id_script(CLIENT_ID))
            page.goto(setup.url)
            wait_for_state_text(page, "Holding")
            wait_until_unchanged(page, 6)  # the 3D view loads again
            save_picture(page, setup.folder / f"{name}-{theme}.webp")
            context.close()
    setup.page.goto(setup.url)
    wait_for_state_text(setup.page, "Holding")


@contextlib.contextmanager
def second_vehicle(setup: PictureSetup) -> Generator[SyncVehicle]:
    """A second vehicle takes off, and lands at the end; its simulator continues to run."""
    with SyncGcs(setup.url, client="pictures", client_id=CLIENT_ID) as gcs:
        if len(gcs.request("GET", "/vehicles")) < 2:
            setup.stack.enter_context(
                running_vehicles(setup.port, arguments=["--first-instance", "101", *FAST_OPTIONS])
            )
        drone_102 = gcs.wait_for_vehicle("102", ready=True, timeout_s=60)
        drone_102.takeoff(8)
        drone_102.until(lambda v: v["status"]["mode"] == "hold", what="the end of the climb")
        yield drone_102
        drone_102.land()
        drone_102.until_disarmed()


def two_vehicles(setup: PictureSetup) -> None:
    """A second vehicle is connected and flies."""
    with second_vehicle(setup):
        save_in_both_themes(setup.page, setup.folder, "two")


def group(setup: PictureSetup) -> None:
    """Both vehicles as a group: state, members, smallest distance, remaining validity."""
    page = setup.page
    with second_vehicle(setup) as drone_102:
        home = setup.drone.topic("home")
        assert home is not None
        drone_102.goto(home["lat_deg"], home["lon_deg"] + 0.00012, alt_home_m=12)
        wait_until_unchanged(page, 4)
        page.keyboard.press("m")
        page.keyboard.press("p")
        view = page.get_by_role("region", name="Offboard view")
        view.get_by_role("radio", name="Group", exact=True).click()
        for box in view.get_by_role("checkbox").all()[:2]:
            box.check()
        view.get_by_label("Minimum separation").fill("2")
        view.get_by_label("Move, North").fill("12")
        view.get_by_role("button", name="Start group…").click()
        confirm_by_space_bar(page)
        view.get_by_text("Flying", exact=True).wait_for()
        wait_until_unchanged(page, 3)
        save_in_both_themes(page, setup.folder, "group")
        view.get_by_role("button", name="Hold group").click()
        wait_for_state_text(page, "Holding")
        page.get_by_role("button", name="Close the offboard view").click()
        page.keyboard.press("m")


def connection_lost(setup: PictureSetup) -> None:
    """The simulator is stopped: the connection is lost."""
    os.killpg(setup.simulator.pid, signal.SIGSTOP)
    try:
        wait_for_state_text(setup.page, "Connection lost")
        wait_until_unchanged(setup.page, 3)
        save_in_both_themes(setup.page, setup.folder, "lost")
    finally:
        os.killpg(setup.simulator.pid, signal.SIGCONT)


def replay(setup: PictureSetup) -> None:
    """A replay of the previous flight, opened from the list, at 30 % of its duration."""
    page = setup.page
    page.get_by_role("button", name="Flights", exact=True).click()
    page.get_by_role("button", name="Replay", exact=True).first.click()
    slider = page.get_by_label("Replay", exact=True).get_by_role("slider").first
    box = bounding_box(slider)
    page.mouse.click(box["x"] + box["width"] * 0.3, box["y"] + box["height"] / 2)
    page.mouse.move(0, 0)
    wait_until_unchanged(page, 4)
    save_in_both_themes(page, setup.folder, "replay")


STATES: tuple[Callable[[PictureSetup], None], ...] = (
    flight_to_position,
    map_menu,
    return_confirmation,
    plan_pictures.plan,
    plan_pictures.mission,
    plan_pictures.dry_run,
    gimbal,
    panels,
    new_rooms,
    mission_in_flight,
    small_screens,
    offboard,
    setpoint_form,
    drag_in_3d,
    refused_disarming,
    two_vehicles,
    group,
    connection_lost,
    replay,
)


@contextlib.contextmanager
def flying_station(folder: Path) -> Generator[PictureSetup]:
    """A station with one vehicle in flight and the page open."""
    port = free_port()
    with contextlib.ExitStack() as stack:
        url, _ = stack.enter_context(running_server([f"udpin://127.0.0.1:{port}"]))
        simulator = stack.enter_context(running_vehicles(port, arguments=FAST_OPTIONS))
        gcs = stack.enter_context(SyncGcs(url, client="pictures", client_id=CLIENT_ID))
        browser = stack.enter_context(chromium())
        page = browser.new_context(
            viewport={"width": DESKTOP_SIZE[0], "height": DESKTOP_SIZE[1]}, color_scheme="dark"
        ).new_page()
        page.add_init_script(client_id_script(CLIENT_ID))
        page.goto(url)
        drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=60)
        drone.takeoff(12)
        wait_for_state_text(page, "Holding")
        yield PictureSetup(browser, page, url, drone, simulator, port, folder, stack)


def main() -> int:
    """Takes the pictures; the exit code is the number of failed states."""
    names = [state.__name__ for state in STATES]
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=IMAGES, help="folder for the pictures")
    parser.add_argument(
        "--only", default="", help=f"states to take, separated by commas, of {', '.join(names)}"
    )
    options = parser.parse_args()
    selected = [name for name in options.only.split(",") if name] or names
    unknown_names = sorted(set(selected) - set(names))
    if unknown_names:
        parser.error(f"unknown states: {', '.join(unknown_names)}; there are {', '.join(names)}")
    options.out.mkdir(parents=True, exist_ok=True)
    build_page.build(REPOSITORY)
    failed: list[str] = []
    with flying_station(options.out) as setup:
        for state in STATES:
            if state.__name__ not in selected:
                continue
            print(state.__name__, flush=True)
            try:
                state(setup)
            except Exception as error:  # the other pictures are still taken
                failed.append(state.__name__)
                print(f"  failed: {error}", file=sys.stderr, flush=True)
                setup.page.keyboard.press("Escape")
    if failed:
        print(f"not taken: {', '.join(failed)}", file=sys.stderr)
    return len(failed)


if __name__ == "__main__":
    sys.exit(main())
