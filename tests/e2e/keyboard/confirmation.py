"""A confirmation dialog of the page, and checks of the rules for all confirmations. The page's commands are
blocked, so that no command reaches the server."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

from playwright.sync_api import Locator, Page, Route, expect

from tests.station import wait_until

KEY_HELD_MS = 150

FOCUSED_ID = """
() => document.activeElement.dataset.focusId ??= String(window.focusIds = (window.focusIds ?? 0) + 1)
"""
HAS_FOCUS = "(dialog) => dialog.contains(document.activeElement)"
COUNT_CONTROLS = """
(dialog) => [...dialog.querySelectorAll('button, input, select, textarea, a[href], [tabindex]')]
  .filter((control) => !control.disabled && control.tabIndex >= 0 && control.checkVisibility()).length
"""
BUTTON_NAMES = """
() => [...new Set([...document.querySelectorAll('button')]
  .filter((button) => !button.disabled && button.ariaDisabled !== 'true' && button.checkVisibility())
  .map((button) => button.ariaLabel ?? button.innerText.replace(/\\s+/g, ' ').trim()))]
"""
"""Names of the enabled buttons. Between parts that are laid out beside each other, `innerText` has a space,
as the accessible name has; `textContent` has no space."""
ANNOUNCED_TEXTS = """
(dialog) => [dialog.getAttribute('aria-modal') === 'true' ? 'modal' : '',
  ...['aria-labelledby', 'aria-describedby'].map((a) => document.getElementById(dialog.getAttribute(a)))
    .map((element) => element?.innerText ?? '')]
"""
AWAIT_DRAWN = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(() => done())))"
FOCUS_BUTTON_OUTSIDE = "() => [...document.querySelectorAll('.dock button')].at(-1).focus()"
OUTSIDE_SELECTORS = ("body", "[role=alertdialog] [aria-label=Cancel]", ".dock button:last-child")
HOLD_KEY_OUTSIDE = """
([where, key, held_ms]) => new Promise((done) => {
  const knob = document.querySelector('[role=alertdialog] [role=slider]');
  const code = key === ' ' ? 'Space' : key;
  const send = (element, type, key, repeat) =>
    element?.dispatchEvent(new KeyboardEvent(type, { key, code, repeat, bubbles: true, cancelable: true }));
  send(knob, 'keydown', 'Home', false);
  send(document.querySelector(where), 'keydown', key, false);
  setTimeout(() => {
    send(document.querySelector(where), 'keydown', key, true);
    requestAnimationFrame(() => done(knob.isConnected ? knob.ariaValueNow : 'closed'));
  }, held_ms);
})
"""
"""Presses and holds a key on an element outside the slider, although this element may not have the focus."""


def refuse_commands(page: Page) -> list[str]:
    """Blocks all commands of the page from now on, and returns the list that records the blocked commands."""
    commands: list[str] = []
    harmless_requests = re.compile("/scene/|/readiness/check|/params/refresh|/plans/check|/futures")

    def refuse(route: Route) -> None:
        if route.request.method == "GET" or harmless_requests.search(route.request.url):
            route.fallback()
            return
        commands.append(route.request.url)
        problem = {"title": "Not in this test", "detail": "No command is sent.", "code": "refused"}
        route.fulfill(status=409, content_type="application/problem+json", json=problem)

    page.route("**/api/v1/**", refuse)
    return commands


def await_command(page: Page, commands: list[str], what: str) -> None:
    """Waits for a command of the page; Playwright delivers requests only during calls to the page."""

    def blocked() -> list[str]:
        page.wait_for_timeout(20)
        return commands

    wait_until(blocked, what)


class Confirmation:
    """An open confirmation dialog, and the rules for all confirmations."""

    def __init__(self, page: Page, commands: list[str]) -> None:
        self.page, self.commands = page, commands
        self.dialog = page.get_by_role("alertdialog")
        self.knob = self.dialog.get_by_role("slider")
        self.title = self.dialog.get_by_role("heading").inner_text()
        self._open_dialog: Callable[[], None] = lambda: None

    def check(self, open_dialog: Callable[[], None]) -> None:
        """Checks the rules; only the dialog's own slider may confirm it. `open_dialog` opens it again."""
        self._open_dialog = open_dialog
        self._check_announcement()
        self._check_focus_stays_in_dialog()
        self._check_keys_outside_are_ignored()
        self._check_cancel_button_and_escape()
        assert self.commands == [], f"{self.title}: a command was sent without confirmation"
        self._check_slider_confirms()

    def open(self) -> None:
        """Opens the confirmation again if it was cancelled or has expired; repeats the key press, because the
        page ignores a key press directly after a confirmation."""

        def is_open() -> bool:
            if not self.dialog.is_visible():
                self._open_dialog()
            return self.dialog.is_visible()

        wait_until(is_open, f"the confirmation {self.title!r}")

    def _check_announcement(self) -> None:
        self.open()
        expect(self.knob, self.title).to_be_focused()
        texts = self.dialog.evaluate(ANNOUNCED_TEXTS)
        assert all(text.strip() for text in texts), (self.title, texts)

    def _check_focus_stays_in_dialog(self) -> None:
        for key in ("Tab", "Shift+Tab"):
            self.open()
            control_count = self.dialog.evaluate(COUNT_CONTROLS)
            focused_ids: set[str] = set()
            for _ in range(control_count + 1):
                self.page.keyboard.press(key)
                assert self.dialog.evaluate(HAS_FOCUS), (
                    f"{self.title}: {key} moves the focus out of the dialog"
                )
                focused_ids.add(self.page.evaluate(FOCUSED_ID))
            assert len(focused_ids) == control_count, f"{self.title}: {key} does not cycle within the dialog"
        self.open()
        self.page.evaluate(FOCUS_BUTTON_OUTSIDE)
        wait_until(lambda: self.dialog.evaluate(HAS_FOCUS), "the return of the focus into the confirmation")

    def _check_keys_outside_are_ignored(self) -> None:
        for selector in OUTSIDE_SELECTORS:
            for key in (" ", "Enter"):
                self.open()
                slider_value = self.page.evaluate(HOLD_KEY_OUTSIDE, [selector, key, KEY_HELD_MS])
                assert slider_value == "0", (
                    f"{self.title}: {key!r} held on {selector} moves the slider to {slider_value}"
                )

    def _check_cancel_button_and_escape(self) -> None:
        for key in ("Enter", "Space"):
            self.open()
            self.dialog.get_by_role("button", name="Cancel").focus()
            self.page.keyboard.down(key)
            self.page.wait_for_timeout(KEY_HELD_MS)
            self.page.keyboard.down(key)  # key repeat
            self.page.keyboard.up(key)
            expect(self.dialog, f"{self.title}: {key} on Cancel").to_be_hidden()
        self.open()
        for key in ("Space", "Enter", "End", "PageUp"):
            self.knob.press(key)  # released at once
        expect(self.knob, self.title).to_have_attribute("aria-valuenow", "0")
        self.page.keyboard.press("Escape")
        expect(self.dialog, f"{self.title}: Escape").to_be_hidden()

    def _check_slider_confirms(self) -> None:
        self.open()
        expect(self.knob).to_be_focused()
        self.page.keyboard.down("Space")
        expect(self.dialog, f"{self.title}: Space held on its slider").to_be_hidden()
        for _ in range(3):
            self.page.keyboard.down("Space")  # key repeat, now with the focus on another button
        self.page.keyboard.up("Space")
        await_command(self.page, self.commands, f"the command of {self.title!r}")
        expect(self.dialog, f"{self.title}: opens again by the same key press").to_be_hidden()
        assert len(self.commands) == 1, (self.title, self.commands)
        self.commands.clear()


def press_new_buttons(
    page: Page, pressed: set[str], where: str, reopen: Callable[[], None] | None
) -> Iterator[tuple[str, Callable[[], None]]]:
    """Presses Enter on each visible button that was not pressed before, on "Close" buttons last. For each
    button that opens a confirmation, yields its name and a function that presses it again.

    Args:
        page: the page.
        pressed: patterns of the names of the buttons pressed before; the function adds patterns.
        where: name of the open view or panel, for messages.
        reopen: opens the view or panel again if a pressed button closed it; None: no button closes it.
    """
    dialog = page.get_by_role("alertdialog")
    for name in sorted(page.evaluate(BUTTON_NAMES), key=lambda name: name.startswith("Close")):
        pattern = re.sub(r"\d+", r"\\d+", re.escape(name)).replace("/", ".")  # some labels contain a number
        name_start = re.compile(f"^{pattern}", re.IGNORECASE)  # the text may be drawn in capitals
        radio, combobox = (page.get_by_role(role, name=name_start) for role in ("radio", "combobox"))
        control = page.get_by_role("button", name=name_start).or_(radio).or_(combobox)
        button = control.first  # the locator also matches controls that appear later
        if pattern in pressed:
            continue
        if reopen is not None and not button.is_visible():
            reopen()
        if not button.is_visible() or button.is_disabled():
            continue
        pressed.add(pattern)

        def press_button(button: Locator = button) -> None:
            button.focus()
            page.keyboard.press("Enter")

        press_button()
        page.evaluate(AWAIT_DRAWN)
        if dialog.is_visible():
            yield f"{name!r} in {where}", press_button
