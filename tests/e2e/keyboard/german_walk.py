"""Presses everything that a German page shows, and reads what appears."""

from __future__ import annotations

import re
from collections.abc import Collection

from playwright.sync_api import Page, Route

from tests.e2e.keyboard.german import english_texts

MAX_PRESSES = 150
APPEARS_MS = 120
"""Texts that come from the server are there by then, or at the next press."""
ONLY_COMPUTES = re.compile(
    "/scene/|/readiness/check|/params/refresh|/flights|/dry-runs"
    "|/plans/(check|pattern|import|convert|insert|ground|divide|table|export)"
)

PRESS_NEXT = """
([room, names]) => {
  const pressed = new Set(names);
  const named = (control) => control.ariaLabel ?? control.innerText;
  const isLast = (control) => /schließen|^Zurück/.test(named(control));
  const controls = [
    ...document.querySelectorAll('button, summary, [role="radio"], [role="tab"], [role="option"]'),
  ].filter((one) => !one.disabled && one.ariaDisabled !== 'true'
    && one.checkVisibility({ visibilityProperty: true }));
  for (const control of controls.sort((a, b) => isLast(a) - isLast(b))) {
    const name = named(control).replace(/[\\d.,:−-]+/g, '#').replace(/\\s+/g, ' ').trim();
    const key = control.matches('[role="option"]') ? `${room} ${name}` : name;
    if (pressed.has(key)) continue;
    control.focus();
    control.click();
    return key;
  }
  return null;
}
"""
"""Presses the first control whose name, without numbers, was not pressed yet, last what closes a view; null:
there is none. Items of a list are pressed in each room."""


def refuse_commands_in_german(page: Page) -> None:
    """Lets no command of the page through that does more than compute."""

    def answer(route: Route) -> None:
        if route.request.method == "GET" or ONLY_COMPUTES.search(route.request.url):
            route.fallback()
            return
        problem = {"title": "Nicht in diesem Test", "detail": "", "code": "refused"}
        route.fulfill(status=409, content_type="application/problem+json", json=problem)

    page.route("**/api/v1/**", answer)


def english_after_each_press(
    page: Page, room: str, pressed: list[str], own_words: Collection[str] = ()
) -> dict[str, list[str]]:
    """Presses all controls of a room, also those that appear meanwhile.

    Args:
        page: the page, whose commands are refused.
        room: name of the room.
        pressed: what was pressed before, without its numbers; the function adds to it.
        own_words: what a person wrote.

    Returns:
        Name of what was pressed, and the English texts that were shown then for the first time.
    """
    found: dict[str, list[str]] = {}
    known: set[str] = set()
    for _ in range(MAX_PRESSES):
        name = page.evaluate(PRESS_NEXT, [room, pressed])
        if name is None:
            break
        pressed.append(name)
        page.wait_for_timeout(APPEARS_MS)
        if new := [text for text in english_texts(page, own_words) if text not in known]:
            found[f"{room}: {name}"] = new
            known.update(new)
        if page.get_by_role("alertdialog").is_visible():
            page.keyboard.press("Escape")
    return found
