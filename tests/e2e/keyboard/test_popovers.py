"""The top bar's panels: keys open and close them, Escape closes the panel only, Hold still works."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.browser import in_both_themes, opened
from tests.e2e.fast_station import Station
from tests.e2e.keyboard.question import await_command, refuse_commands

pytestmark = pytest.mark.browser


def test_escape_closes_the_panel_only_and_returns_the_focus(browser: Browser, flying: Station) -> None:
    with opened(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        page.keyboard.press("y")
        checks = page.get_by_role("region", name="Readiness")
        expect(checks).to_be_visible()
        for name, panel_name in (
            ("Battery", "Battery: details"),
            ("You have control", "Control of 101 Quad"),
        ):
            button = page.get_by_role("button", name=name)
            button.press("Enter")
            panel = page.get_by_role("dialog", name=panel_name)
            expect(panel).to_be_visible()
            assert in_both_themes(page) == []
            page.keyboard.press("Escape")
            expect(panel).to_be_hidden()
            expect(button).to_be_focused()
            expect(checks).to_be_visible()
        page.keyboard.press("Escape")
        expect(checks).to_be_hidden()


def test_a_panel_closes_when_the_focus_leaves_it_and_hold_works_beside_it(
    browser: Browser, flying: Station
) -> None:
    with opened(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        commands = refuse_commands(page)
        page.keyboard.press("c")
        panel = page.get_by_role("dialog", name="Control of 101 Quad")
        expect(panel.get_by_role("button", name="Release control")).to_be_focused()
        page.keyboard.press("h")
        await_command(page, commands, "Hold in the panel")
        assert commands.pop().endswith("/vehicles/101/hold")
        page.get_by_role("toolbar", name="Actions").get_by_role("button", name="Hold").click()
        await_command(page, commands, "Hold by its button")
        assert commands.pop().endswith("/vehicles/101/hold")
        expect(panel).to_be_hidden()

        page.keyboard.press("c")
        expect(panel.get_by_role("button", name="Release control")).to_be_focused()
        land = page.get_by_role("toolbar", name="Actions").get_by_role("button", name="Land", exact=True)
        land.focus()
        expect(panel).to_be_hidden()
        expect(land).to_be_focused()

        page.keyboard.press("c")
        page.keyboard.press("Shift+K")
        question = page.get_by_role("alertdialog")
        expect(question.get_by_role("slider")).to_be_focused()
        expect(panel).to_be_hidden()
        page.keyboard.press("Escape")
        expect(question).to_be_hidden()
