"""Presses Tab through the page and checks the reached controls; opens each view and panel by keyboard."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from playwright.sync_api import Page

from tests.station import wait_until

MAX_TAB_PRESSES = 300
PRESSES_PER_CHECK = 20
MAX_PANELS = 6
MAX_ROUNDS = 3

RECORD_FOCUS = """
() => {
  if (!window.reached) document.addEventListener('focusin', (e) => window.reached.add(e.target));
  window.reached = new Set();
  document.activeElement.blur();
}
"""
UNREACHED_CONTROLS = """
() => [...document.querySelectorAll(
    'a[href], button, input, select, textarea, summary, [tabindex], [role="slider"], [role="button"]')]
  .filter((control) => !control.disabled && control.tabIndex >= 0
    && control.checkVisibility({ visibilityProperty: true })
    && control.closest('[aria-hidden="true"], [inert]') === null && !window.reached.has(control)
    && control.type !== 'radio')
  .map((control) => control.outerHTML.slice(0, 140))
"""
CONTROLS_WITHOUT_NAME = """
() => [...window.reached]
  .filter((control) => control.isConnected && control !== document.body && control.tabIndex >= 0
    && !(control.ariaLabel || control.textContent.trim() || control.title || control.labels?.length))
  .map((control) => control.outerHTML.slice(0, 140))
"""


def check_tab_order(page: Page, tab_key: str) -> None:
    """Presses Tab through the whole page; checks that every visible control is reached and has a name.

    A control that appears before the focused control, such as a warning, is reached in the next round.
    """
    page.evaluate(RECORD_FOCUS)
    for _ in range(MAX_ROUNDS):
        _press_tab_for_a_round(page, tab_key)
        if page.evaluate(UNREACHED_CONTROLS) == []:
            break
    for script, what in ((UNREACHED_CONTROLS, "not reached"), (CONTROLS_WITHOUT_NAME, "without a name")):
        found = page.evaluate(script)
        assert found == [], f"{what}: {found}"  # this module's assertions are not rewritten by pytest


def _press_tab_for_a_round(page: Page, tab_key: str) -> None:
    for _ in range(0, MAX_TAB_PRESSES, PRESSES_PER_CHECK):
        count_before = page.evaluate("() => window.reached.size")
        for _ in range(PRESSES_PER_CHECK):
            page.keyboard.press(tab_key)
        if page.evaluate("() => window.reached.size") == count_before:
            return  # all controls were reached
    pytest.fail(f"{MAX_TAB_PRESSES} presses of {tab_key} do not complete a round")


def views_and_panels(page: Page, text: Callable[[str], str] = str) -> list[tuple[str, Callable[[], None]]]:
    """Name of each view and panel, and a function that opens it by keyboard.

    Args:
        page: the page.
        text: the page's text for an English one.
    """

    input_selector = page.get_by_label(text("Setpoint input"))

    def open_offboard_view() -> None:
        if not input_selector.is_visible():
            page.keyboard.press("p")
            input_selector.wait_for()

    def input_opener(name: str) -> Callable[[], None]:
        def open_input() -> None:
            open_offboard_view()
            input_selector.get_by_role("radio", name=text(name), exact=True).focus()
            page.keyboard.press("Enter")

        return open_input

    def open_flights() -> None:
        flights = page.get_by_role("region", name=text("Flights"), exact=True)
        views = page.get_by_role("navigation", name=text("Views"))
        # A room that is still loading is open, and the key would close it.
        if (
            views.get_by_role("button", name=text("Flights"), exact=True).get_attribute("aria-current")
            is None
        ):
            page.keyboard.press("Shift+E")
        listed = flights.get_by_role("list").or_(flights.get_by_text(text("No flights yet"))).first
        back = flights.get_by_role("button", name=text("Back to the list of flights"))
        listed.or_(back).first.wait_for()
        if back.is_visible():  # a flight or live plots are open
            back.focus()
            page.keyboard.press("Enter")
        listed.wait_for()

    def open_live_plots() -> None:
        open_flights()
        flights = page.get_by_role("region", name=text("Flights"), exact=True)
        flights.get_by_role("button", name=text("Live plots of {0}").replace("{0}", "Quad 101")).focus()
        page.keyboard.press("Enter")
        flights.get_by_label(text("Search fields")).wait_for()  # it is there once a message has arrived

    def open_gamepad_page() -> None:
        settings = page.get_by_role("region", name=text("Settings"), exact=True)
        if not settings.is_visible():
            page.keyboard.press("Shift+U")
        settings.get_by_role("radio", name=text("Gamepad"), exact=True).focus()
        page.keyboard.press("Enter")
        settings.get_by_text(text("Buttons while one flies by stick")).wait_for()

    def open_autotune_page() -> None:
        vehicle = page.get_by_role("region", name=text("Vehicle set-up"), exact=True)
        if not vehicle.is_visible():
            page.keyboard.press("Shift+V")
        vehicle.get_by_role("radio", name=text("Autotune"), exact=True).focus()
        page.keyboard.press("Enter")
        vehicle.get_by_role("region", name=text("Gains"), exact=True).wait_for()

    def open_point_menu() -> None:
        point_menu = page.get_by_role("dialog", name=text("At this position"))

        def is_open() -> bool:
            page.get_by_role("application", name=text("Map from above")).focus()
            page.keyboard.press("Shift+ArrowUp")  # moves the crosshair away from the vehicle
            page.keyboard.press("Enter")
            return point_menu.is_visible()

        wait_until(is_open, "the menu at a position")

    def key_presser(character: str) -> Callable[[], None]:
        return lambda: page.keyboard.press(character)

    keys = {"messages": "n", "values": "v", "readiness": "y", "parameters": "i", "control": "c", "help": "?"}
    keys |= {
        "vehicles": "j",
        "guide": "b",
        "console": "s",
        "inspector": "Shift+X",
        "files": "Shift+B",
        "measure": "d",
        "search": "Control+k",
    }
    keys |= {"modes": "Shift+M", "map sources": "Shift+F", "settings": "Shift+U"}
    inputs = [(f"view: {name}", input_opener(name)) for name in ("Form", "Drag in 3D", "Gamepad", "Group")]
    return [
        ("fly", lambda: None),
        *((name, key_presser(character)) for name, character in keys.items()),
        ("map point menu", open_point_menu),
        ("view: vehicle", key_presser("Shift+V")),
        ("view: plan", key_presser("w")),
        ("view: flights", open_flights),
        ("view: live plots", open_live_plots),
        ("view: gamepad", open_gamepad_page),
        ("view: autotune", open_autotune_page),
        ("view: offboard", open_offboard_view),
        *inputs,
    ]


def close_all(page: Page) -> None:
    """Closes all views and panels by Escape."""
    for _ in range(MAX_PANELS):
        page.keyboard.press("Escape")
