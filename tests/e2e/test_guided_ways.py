"""Every guided action in one flight, three times: by a mouse from the map, by keys alone, and by a thumb on a
phone. The vehicle's own state shows that it did it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from gcs_server.client import SyncGcs, SyncVehicle
from tests.e2e.browser import confirm_by_slider, confirm_by_space_bar, open_page, tab_to
from tests.e2e.fast_station import FAST_OPTIONS, Station, take_off_to_hold
from tests.e2e.touch import phone, slide_by_touch
from tests.station import free_port, running_server, running_vehicles, wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story]

PLACE_ENTRIES = {
    "Go to": "Go with speed or heading…",
    "Orbit": "Orbit here…",
    "Home": "Set home here…",
    "Heading": "Turn nose here…",
}
"""Commands that the menu of a place on the map opens."""


@pytest.fixture(scope="module")
def station() -> Iterator[Station]:
    """Two vehicles: one flies all actions, and follows the other."""
    port = free_port()
    with (
        running_server([f"udpin://127.0.0.1:{port}"]) as (url, _),
        running_vehicles(port, instances=2, arguments=FAST_OPTIONS),
        SyncGcs(url, client="e2e") as gcs,
    ):
        gcs.wait_for_vehicle("102", ready=True, timeout_s=120)
        yield Station(url, gcs, gcs.wait_for_vehicle("101", ready=True, timeout_s=120))


class Mouse:
    """A mouse, from the menu of a place on the map."""

    def __init__(self, page: Page) -> None:
        self.page = page
        self.panel = page.get_by_label("Guide", exact=True)

    def open(self, command: str) -> None:
        """Opens the command's form."""
        if self.panel.is_visible():
            self.panel.get_by_role("button", name="Close").click()
        self.press_map()
        menu = self.page.get_by_role("dialog")
        self.press(menu.get_by_role("button", name=PLACE_ENTRIES.get(command, "Orbit here…")))
        if command not in PLACE_ENTRIES:
            self.press(self.panel.get_by_role("radio", name=command, exact=True))

    def press_map(self) -> None:
        self.page.get_by_role("toolbar", name="Map").wait_for()
        self.page.mouse.click(760, 300)

    def press(self, button: Locator) -> None:
        button.click()

    def enter(self, label: str, text: str) -> None:
        self.panel.get_by_label(label, exact=True).fill(text)

    def choose(self, label: str, option: str) -> None:
        self.panel.get_by_label(label, exact=True).select_option(label=option)

    def confirm(self) -> None:
        confirm_by_slider(self.page)


class Thumb(Mouse):
    """A thumb on a phone."""

    def press_map(self) -> None:
        self.page.get_by_role("toolbar", name="Map").wait_for()
        self.page.touchscreen.tap(200, 300)

    def press(self, button: Locator) -> None:
        button.tap()

    def confirm(self) -> None:
        slide_by_touch(self.page)


class Keys(Mouse):
    """Keys alone: nothing is clicked."""

    def open(self, command: str) -> None:
        if self.panel.is_visible():
            self.page.keyboard.press("b")
        if command in ("Go to",):  # its place is the crosshair of the map
            self.page.get_by_label(re.compile("^Map from above")).focus()
            for _ in range(3):
                self.page.keyboard.press("Shift+ArrowUp")
            self.page.keyboard.press("Enter")
            tab_to(self.page, PLACE_ENTRIES[command])
            self.page.keyboard.press("Enter")
        else:
            self.page.keyboard.press("b")
            expect(self.panel).to_be_focused()
            checked = self.panel.get_by_role("radio", name=command, exact=True)
            for _ in range(10):
                self.page.keyboard.press("Tab")
                if self.page.evaluate("() => document.activeElement.role") == "radio":
                    break
            for _ in range(10):
                if checked.get_attribute("aria-checked") == "true":
                    return
                self.page.keyboard.press("ArrowRight")
            pytest.fail(f"the arrow keys did not reach {command}")

    def press(self, button: Locator) -> None:
        tab_to(self.page, button.inner_text().strip())
        self.page.keyboard.press("Enter")

    def enter(self, label: str, text: str) -> None:
        self._focus(label)
        self.page.keyboard.press("Control+a")
        self.page.keyboard.type(text)

    def choose(self, label: str, option: str) -> None:
        self._focus(label)
        self.page.keyboard.type(option)

    def confirm(self) -> None:
        confirm_by_space_bar(self.page)

    def _focus(self, label: str) -> None:
        field = self.panel.get_by_label(label, exact=True)
        for _ in range(40):
            self.page.keyboard.press("Tab")
            if field.evaluate("(element) => element === document.activeElement"):
                return
        pytest.fail(f"Tab did not reach {label}")


def position(drone: SyncVehicle) -> dict[str, float]:
    value = drone.topic("global_position")
    assert value is not None
    return value


def fly_every_action(hand: Mouse, station: Station) -> None:
    """Gives each guided command once, and waits for what the vehicle does."""
    drone, panel = station.drone, hand.panel

    def command(name: str, button: str) -> None:
        hand.open(name)
        for label, text in FIELDS.get(name, {}).items():
            hand.enter(label, text)
        hand.press(panel.get_by_role("button", name=f"{button}…"))
        hand.confirm()

    command("Altitude", "Change altitude")
    expect(panel).to_contain_text("Reached 16.0 m above home", timeout=30_000)
    assert abs(position(drone)["alt_home_m"] - 16) < 2.5

    hand.open("Heading")
    hand.enter("Heading", "200")
    hand.press(panel.get_by_role("button", name="Turn…"))
    hand.confirm()
    expect(panel).to_contain_text("Turned to 200°", timeout=30_000)
    assert abs(math.remainder(position(drone)["heading_deg"] - 200, 360)) < 12

    before = position(drone)
    command("Go to", "Go")
    expect(panel).to_contain_text("Reached the position", timeout=60_000)
    moved = position(drone)
    assert max(abs(moved[axis] - before[axis]) for axis in ("lat_deg", "lon_deg")) > 2e-5

    command("Speed", "Change speed")
    expect(panel).to_contain_text("4 m/s commanded", timeout=30_000)

    command("Orbit", "Orbit")
    expect(panel).to_contain_text("Orbit of 12 m", timeout=30_000)
    assert drone.topic("orbit")["radius_m"] == 12  # type: ignore[index]
    # The button of the page's bar works beside the open form; Follow needs Hold.
    hand.press(
        hand.page.get_by_role("toolbar", name="Actions").get_by_role("button", name=re.compile("^Hold"))
    )
    drone.until(lambda v: v["status"]["mode"] == "hold", what="Hold")

    hand.open("Follow")
    leader = panel.get_by_label("Whom", exact=True).locator("option").nth(1).inner_text()
    hand.choose("Whom", leader)
    hand.press(panel.get_by_role("button", name="Follow…"))
    hand.confirm()
    expect(panel).to_contain_text(f"Follows {leader}", timeout=30_000)
    assert drone.status()["mode"] == "offboard"
    hand.page.keyboard.press("h")
    expect(panel).to_contain_text("Following has ended", timeout=30_000)

    hand.open("Home")
    hand.press(panel.get_by_role("button", name="Set home…"))
    home = drone.topic("home")
    assert home is not None
    hand.confirm()
    expect(panel).to_contain_text("Home is set.", timeout=30_000)
    wait_until(lambda: drone.topic("home") != home, "the new home")


FIELDS = {
    "Altitude": {"Altitude above home": "16"},
    "Go to": {"Ground speed": "6"},
    "Speed": {"Ground speed": "4"},
    "Orbit": {"Radius": "12", "Ground speed": "3"},
}
"""What is typed into the form of each command."""


@pytest.mark.parametrize("way", [Mouse, Keys, Thumb])
def test_every_guided_action_is_given_and_flown(browser: Browser, station: Station, way: type[Mouse]) -> None:
    for vehicle_id in ("101", "102"):
        drone = station.gcs.vehicle(vehicle_id)
        if not drone.status()["armed"]:
            take_off_to_hold(drone)
    if way is Thumb:
        with phone(browser, station) as page:
            fly_every_action(Thumb(page), station)
    else:
        with open_page(browser, station.url, size=(1280, 800), scene=False) as page:
            page.locator(".pill").wait_for()
            fly_every_action(way(page), station)
