"""Single keys on Cancel, on and after other controls, with shortcuts off, and on the gimbal's pad."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.browser import open_page, press_key, violations_in_both_themes
from tests.e2e.fast_station import Station
from tests.e2e.keyboard.confirmation import Confirmation, await_command, refuse_commands
from tests.station import wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story]

LONGER_THAN_ANY_KEY_HOLD_MS = 2_000


@pytest.mark.parametrize("key", ["Space", "Enter"])
def test_a_key_held_on_cancel_does_not_stop_the_motors(
    browser: Browser, flying_station: Station, key: str
) -> None:
    with open_page(browser, flying_station.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        commands = refuse_commands(page)
        page.keyboard.press("Shift+K")
        dialog = page.get_by_role("alertdialog")
        dialog.get_by_role("button", name="Cancel").focus()
        for _ in range(5):  # key repeat
            page.keyboard.down(key)
            page.wait_for_timeout(LONGER_THAN_ANY_KEY_HOLD_MS / 5)
        page.keyboard.up(key)
        expect(dialog).to_be_hidden()
        assert commands == []


def test_stopping_the_motors_is_confirmed_only_by_its_own_slider(
    browser: Browser, flying_station: Station
) -> None:
    with open_page(browser, flying_station.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        commands = refuse_commands(page)

        def open_confirmation() -> None:
            page.keyboard.press("Shift+K")

        open_confirmation()
        Confirmation(page, commands).check(open_confirmation)
    assert flying_station.drone.status()["armed"]


def test_the_hold_key_works_on_a_checkbox_and_a_list_but_not_in_a_text_field_or_with_shortcuts_off(
    browser: Browser, flying_station: Station
) -> None:
    drone = flying_station.drone
    with open_page(browser, flying_station.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        commands = refuse_commands(page)
        page.keyboard.press("p")
        view = page.get_by_role("region", name="Offboard view")
        checkbox = view.get_by_role("checkbox", name="Renew while this page is open")
        checkbox.focus()
        page.keyboard.press("Space")
        page.keyboard.press("h")
        await_command(page, commands, "Hold on a checkbox")
        assert commands.pop().endswith("/vehicles/101/hold")

        view.locator("summary").first.press("Enter")
        action_list = view.get_by_label("Failsafe action")
        action_list.focus()
        selected_action = action_list.input_value()
        page.keyboard.press("h")
        await_command(page, commands, "Hold on a list")
        assert commands.pop().endswith("/vehicles/101/hold")
        assert action_list.input_value() == selected_action

        text_field = view.get_by_label("Valid for, seconds")
        text_field.press("h")
        assert commands == []  # the field receives the letter

        # With shortcuts disabled only Escape works; the page shows this, also after a reload.
        page.keyboard.press("Escape")
        press_key(page.get_by_role("button", name="Fly", exact=True), "Enter")
        page.keyboard.press("?")
        press_key(page.get_by_role("checkbox", name="Single-key shortcuts"), "Space")
        expect(page.get_by_role("status").filter(has_text="The H key is off")).to_be_visible()
        assert violations_in_both_themes(page) == []
        page.keyboard.press("Escape")
        page.reload()
        expect(page.locator(".pill b")).to_have_text("Holding")
        keys_off = page.get_by_role("button", name="Keys off")
        expect(keys_off).to_contain_text("Keys off")
        for key in ("h", "t", "Shift+K", "?", "1"):
            page.keyboard.press(key)
        expect(page.get_by_role("alertdialog")).to_have_count(0)
        press_key(keys_off, "Enter")
        press_key(page.get_by_role("checkbox", name="Single-key shortcuts"), "Space")
        page.keyboard.press("h")
        await_command(page, commands, "Hold, after the keys were enabled again")
    assert drone.status()["armed"]


def test_the_gimbal_is_pointed_by_keys(browser: Browser, flying_station: Station) -> None:
    with open_page(browser, flying_station.url, scene=False) as page:
        card = page.get_by_label("Gimbal", exact=True)
        press_key(card.get_by_role("button", name="Take"), "Enter")
        pad = card.get_by_role("slider", name="Gimbal pad")
        pad.press("Home")
        expect(pad).to_have_attribute("aria-valuetext", "0° up, 0° right")
        for key in ("PageDown", "PageDown", "ArrowDown", "ArrowRight"):
            pad.press(key)
        expect(pad).to_have_attribute("aria-valuetext", "21° down, 1° right")
        expect(pad).to_have_attribute("aria-valuenow", "-21")

        def pitch_rad() -> float:
            gimbal = flying_station.drone.topic("gimbal")
            return 0.0 if gimbal is None else float(gimbal["pitch_rad"])

        wait_until(lambda: pitch_rad() < -0.3, "the gimbal moved by keys")
        press_key(card.get_by_role("button", name="Release"), "Enter")
