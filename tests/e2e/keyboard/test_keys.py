"""Single keys: on Cancel, after the use of other controls, on the gimbal's pad."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.browser import open_page, press, violations_in_both_themes
from tests.e2e.fast_station import Station
from tests.e2e.keyboard.confirmation import Confirmation, await_command, refuse_commands
from tests.station import wait_until

pytestmark = [pytest.mark.browser, pytest.mark.story]

LONGER_THAN_ANY_HOLD_MS = 2_000


@pytest.mark.parametrize("key", ["Space", "Enter"])
def test_a_key_held_on_cancel_does_not_stop_the_motors(browser: Browser, flying: Station, key: str) -> None:
    with open_page(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        commands = refuse_commands(page)
        page.keyboard.press("Shift+K")
        dialog = page.get_by_role("alertdialog")
        dialog.get_by_role("button", name="Cancel").focus()
        for _ in range(5):  # key repeat
            page.keyboard.down(key)
            page.wait_for_timeout(LONGER_THAN_ANY_HOLD_MS / 5)
        page.keyboard.up(key)
        expect(dialog).to_be_hidden()
        assert commands == []


def test_stopping_the_motors_is_confirmed_only_by_its_own_slider(browser: Browser, flying: Station) -> None:
    with open_page(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        commands = refuse_commands(page)

        def request() -> None:
            page.keyboard.press("Shift+K")

        request()
        Confirmation(page, commands).check(request)
    assert flying.drone.status()["armed"]


def test_the_hold_key_works_after_using_a_checkbox_a_list_and_a_slider(
    browser: Browser, flying: Station
) -> None:
    drone = flying.drone
    with open_page(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        commands = refuse_commands(page)
        page.keyboard.press("p")
        view = page.get_by_role("region", name="Offboard view")
        box = view.get_by_role("checkbox", name="Renew while this page is open")
        box.focus()
        page.keyboard.press("Space")
        page.keyboard.press("h")
        await_command(page, commands, "Hold after a checkbox")
        assert commands.pop().endswith("/vehicles/101/hold")

        view.locator("summary").first.press("Enter")
        choice = view.get_by_label("Failsafe action")
        choice.focus()
        before = choice.input_value()
        page.keyboard.press("h")
        await_command(page, commands, "Hold on a list")
        assert commands.pop().endswith("/vehicles/101/hold")
        assert choice.input_value() == before

        text_field = view.get_by_label("Valid for, seconds")
        text_field.press("h")
        assert commands == []  # the field receives the letter

        # With shortcuts disabled only Escape works; the page shows that they are off, also after a reload.
        page.keyboard.press("Escape")
        press(page.get_by_role("button", name="Fly", exact=True), "Enter")
        page.keyboard.press("?")
        press(page.get_by_role("checkbox", name="Single-key shortcuts"), "Space")
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
        press(keys_off, "Enter")
        press(page.get_by_role("checkbox", name="Single-key shortcuts"), "Space")
        page.keyboard.press("h")
        await_command(page, commands, "Hold, after the keys were enabled again")
    assert drone.status()["armed"]


def test_the_gimbal_is_pointed_by_arrow_keys(browser: Browser, flying: Station) -> None:
    with open_page(browser, flying.url, scene=False) as page:
        card = page.get_by_label("Gimbal", exact=True)
        press(card.get_by_role("button", name="Take"), "Enter")
        pad = card.get_by_role("slider", name="Gimbal pad")
        pad.press("Home")
        expect(pad).to_have_attribute("aria-valuetext", "0° up, 0° right")
        for key in ("PageDown", "PageDown", "ArrowDown", "ArrowRight"):
            pad.press(key)
        expect(pad).to_have_attribute("aria-valuetext", "21° down, 1° right")
        expect(pad).to_have_attribute("aria-valuenow", "-21")

        def pitch_rad() -> float:
            gimbal = flying.drone.topic("gimbal")
            return 0.0 if gimbal is None else float(gimbal["pitch_rad"])

        wait_until(lambda: pitch_rad() < -0.3, "the gimbal moved by keys")
        press(card.get_by_role("button", name="Release"), "Enter")
