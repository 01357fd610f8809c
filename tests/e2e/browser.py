"""Runs Chromium with a real server, and checks each page for errors that must never happen."""

from __future__ import annotations

import contextlib
import json
import re
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import (
    Browser,
    ConsoleMessage,
    Error,
    FloatRect,
    Frame,
    Locator,
    Page,
    TimeoutError,
    expect,
    sync_playwright,
)

from tools import build_page
from tools.ensure_browser import installed_chromium

REPOSITORY = Path(__file__).resolve().parents[2]
CHROMIUM_FLAGS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-gpu-compositing",
    "--disable-background-networking",
]
"""Chromium renders WebGL in software. It composites the page without WebGL, because compositing with WebGL
would take another core."""
TIMEOUT_MS = 60_000
"""Chromium renders in software, and the machine may be busy."""

MEASURE_TIMEOUT_MS = 5_000
"""Time limit for reading the position of a visible element, which may disappear at any time."""

MAX_ATTEMPTS = 6
"""Number of times that `confirm_by_slider` opens a confirmation."""

COARSE_PIXEL_RATIO = 0.5
"""Device pixels per CSS pixel: the layout is the same, and rendering map and 3D view takes a quarter of the
CPU time."""

MAX_TAB_PRESSES = 80

SET_CLIENT_ID = """
sessionStorage.setItem('gcs.client-id', %s);
sessionStorage.setItem('gcs.left', '1');
"""
"""Sets the page's client id, which the tab keeps across reloads."""
REPORT_CSP_VIOLATIONS = """
addEventListener('securitypolicyviolation', (e) =>
  console.error(`policy: ${e.effectiveDirective} stopped ${e.blockedURI}`));
"""
READ_CANVAS = """
() => new Promise((done) => requestAnimationFrame(() => {
  const canvas = document.querySelector('canvas[data-engine]');
  const gl = canvas && canvas.getContext('webgl2');
  if (!gl) return done({ drawn: 0, colours: 0 });
  const pixels = new Uint8Array(canvas.width * canvas.height * 4);
  gl.readPixels(0, 0, canvas.width, canvas.height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  const colours = new Set();
  let drawn = 0;
  for (let i = 0; i < pixels.length; i += 4) {
    if (pixels[i + 3] > 0) drawn += 1;
    colours.add((pixels[i] << 16) | (pixels[i + 1] << 8) | pixels[i + 2]);
  }
  done({ drawn: drawn / (pixels.length / 4), colours: colours.size });
}))
"""
"""Reads the canvas while a frame is rendered: the browser clears the buffer after each frame. Returns the
share of pixels that are drawn, and the number of colours."""


@contextlib.contextmanager
def chromium() -> Generator[Browser]:
    """Debian's or Playwright's Chromium.

    Raises:
        pytest.fail.Exception: neither is installed; the message has the command that installs it.
    """
    expect.set_options(timeout=TIMEOUT_MS)
    with sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(executable_path=installed_chromium(), args=CHROMIUM_FLAGS)
        except Error as error:
            pytest.fail(
                "These tests need Chromium. Run: sudo apt-get install chromium  "
                f"(or: python -m playwright install --with-deps chromium)\n{error}",
                pytrace=False,
            )
        yield browser
        browser.close()


def client_id_script(client_id: str) -> str:
    """A script that gives the page this client id."""
    return f"if (window === window.top) {{ {SET_CLIENT_ID % json.dumps(client_id)} }}"


def press_key(control: Locator, key: str) -> None:
    """Waits until a control is enabled and presses a key on it; a disabled control would ignore the key."""
    expect(control).to_be_enabled()
    control.press(key)


def choose_menu_entry(menu_button: Locator, entry: str) -> None:
    """Opens a button's menu and chooses an entry of it."""
    menu_button.click()
    menu_button.page.get_by_role("menuitem", name=entry, exact=True).click()


class PageMonitor:
    """Records all requests and errors of a page."""

    def __init__(self, page: Page, url: str) -> None:
        self.console_errors: list[str] = []
        self.foreign_requests: list[str] = []
        self._server_address = urlsplit(url).netloc
        page.add_init_script(REPORT_CSP_VIOLATIONS)
        page.on("console", self._record_console_error)
        page.on("pageerror", lambda error: self.console_errors.append(str(error)))
        page.on("request", lambda request: self._record_request(request.url))
        page.on("websocket", lambda socket: self._record_request(socket.url))

    def _record_console_error(self, message: ConsoleMessage) -> None:
        if message.type == "error" and not self._is_expected(message):
            self.console_errors.append(f"{message.text} {message.location['url']}")

    @staticmethod
    def _is_expected(message: ConsoleMessage) -> bool:
        """Whether this error is expected, such as a refused request or a request for a vehicle that was just
        removed."""
        if re.search("status of (409|503)", message.text):
            return True
        if "status of 504" in message.text and message.location["url"].endswith("/hold"):
            return True  # Hold, sent to a vehicle whose connection is lost
        places = "plans/(check|import|insert|table)|map_sources|elevation/sources|settings|links|flights/"
        may_be_invalid = rf"/api/v1/({places}\w+/rerun)"
        if "status of 422" in message.text and re.search(may_be_invalid, message.location["url"]):
            return True  # an unreadable file, a mission that contradicts itself, an address without tiles
        if message.text.startswith("Tried to update non-existent component"):
            return True  # viser's client renders slower than labels change, and shows the next update
        return "status of 404" in message.text and "/api/v1/vehicles/" in message.location["url"]

    def _record_request(self, url: str) -> None:
        address = urlsplit(url)
        if address.scheme not in ("data", "blob") and address.netloc != self._server_address:
            self.foreign_requests.append(url)

    def check(self) -> None:
        """Fails if the page sent a request to another machine, logged an error or violated its policy."""
        assert not self.foreign_requests, self.foreign_requests
        assert not self.console_errors, self.console_errors


@contextlib.contextmanager
def open_page(
    browser: Browser,
    url: str,
    *,
    theme: Any = "dark",
    size: tuple[int, int] = (1440, 900),
    scene: bool = True,
    script: str = "",
    client_id: str = "e2e",
    coarse: bool = True,
) -> Generator[Page]:
    """Opens the page in a new window and checks it until it is closed.

    Args:
        browser: a running Chromium.
        url: address of the page.
        theme: colour scheme of the browser.
        size: size of the window [CSS px].
        scene: False: the 3D view is not available. Rendering the view in software takes most of a small
            machine.
        script: JavaScript that runs before the scripts of the page.
        client_id: id of the client. The default is the id of the test's programs, so that the page also has
            control of their vehicles.
        coarse: whether to render with few pixels; False for pictures in the documentation.
    """
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]},
        color_scheme=theme,
        device_scale_factor=COARSE_PIXEL_RATIO if coarse else 1,
    )
    context.set_default_timeout(TIMEOUT_MS)
    page = context.new_page()
    page.add_init_script(client_id_script(client_id))
    if script:
        page.add_init_script(script)
    monitor = PageMonitor(page, url)
    if not scene:
        page.route("**/scene/**", lambda route: route.fulfill(content_type="text/plain", body=""))
    try:
        page.goto(url)
        yield page
        monitor.check()
    finally:
        context.close()


def bounding_box(control: Locator) -> FloatRect:
    """Position and size of a control in the window [px], once it is visible."""
    expect(control).to_be_visible()
    box = control.bounding_box()
    assert box is not None, "the control was hidden again"
    return box


def confirm_by_slider(page: Page, open_again: Callable[[], object] = lambda: None) -> None:
    """Confirms the open confirmation: drags its slider to the end with the mouse.

    Args:
        page: the page.
        open_again: opens the confirmation again if it has expired: it expires after 5 s, and a busy machine
            may need longer.
    """
    knob = page.get_by_role("alertdialog").get_by_role("slider")
    for attempt in range(MAX_ATTEMPTS):
        if attempt:
            open_again()
        try:
            knob.wait_for(timeout=MEASURE_TIMEOUT_MS)
            box = knob.bounding_box(timeout=MEASURE_TIMEOUT_MS)
        except TimeoutError:
            continue
        if box is None:
            continue
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        slider_held = knob.is_visible()  # the confirmation does not expire while the slider is held
        page.mouse.move(x + 400, y, steps=8)
        page.mouse.up()
        if slider_held:
            return
    raise AssertionError(
        f"the confirmation did not open, or expired before the slider was held, {MAX_ATTEMPTS} times"
    )


def confirm_by_space_bar(page: Page) -> None:
    """Confirms the open confirmation: holds the Space bar until the confirmation closes."""
    page.get_by_role("alertdialog").wait_for()
    page.keyboard.down("Space")
    page.get_by_role("alertdialog").wait_for(state="hidden")
    page.keyboard.up("Space")


def first_number(text: str) -> float:
    """The first number in a text of the page, which has typographic minus signs.

    Raises:
        ValueError: the text has no number.
    """
    found = re.search(r"-?\d+(\.\d+)?", text.replace("−", "-"))
    if found is None:
        raise ValueError(f"no number in {text!r}")
    return float(found.group())


def shown_value(parent: Locator, label: str) -> float:
    """The value that the page displays with this label."""
    return first_number(
        parent.locator(".value", has=parent.page.get_by_text(label, exact=True)).locator(".text").inner_text()
    )


def scene_frame(page: Page) -> Frame:
    """The document of the 3D view."""
    frame = page.get_by_title("3D view", exact=True).element_handle().content_frame()
    assert frame is not None
    return frame


def violations_in_both_themes(page: Page) -> list[str]:
    """`serious_violations` of the current page in the dark and the light theme. The page must be dark before,
    and is dark afterwards."""
    found = serious_violations(page)
    page.emulate_media(color_scheme="light")
    if page.locator("html[data-theme]").count():  # only the dashboard; other pages use the media query
        page.locator('html[data-theme="light"]').wait_for(state="attached")
    found += [f"light: {violation}" for violation in serious_violations(page)]
    page.emulate_media(color_scheme="dark")
    return found


def tab_to(page: Page, name: str) -> None:
    """Presses Tab until the button or field with this name has the focus."""
    focused_name = "() => document.activeElement.ariaLabel ?? document.activeElement.textContent.trim()"
    for _ in range(MAX_TAB_PRESSES):
        page.keyboard.press("Tab")
        if page.evaluate(focused_name) == name:
            return
    pytest.fail(f"{MAX_TAB_PRESSES} presses of Tab did not reach {name!r}")


def serious_violations(page: Page) -> list[str]:
    """Serious and critical accessibility violations that axe-core finds in the page."""
    return violations(page, ("serious", "critical"))


def violations(
    page: Page, impacts: Sequence[str] = ("minor", "moderate", "serious", "critical")
) -> list[str]:
    """Accessibility violations of these impacts that axe-core finds in the page."""
    build_page.install(REPOSITORY)
    source = (REPOSITORY / "web" / "node_modules" / "axe-core" / "axe.min.js").read_text(encoding="utf-8")
    page.evaluate(f"{source}; void 0")
    # Elements that are fading in have no final contrast yet.
    page.evaluate("() => Promise.allSettled(document.getAnimations().map((animation) => animation.finished))")
    found = page.evaluate(
        "async () => (await axe.run({ exclude: ['iframe'] }, { resultTypes: ['violations'] })).violations"
    )
    return [
        f"{violation['id']}: "
        f"{[(node['html'][:160], node['failureSummary'][-200:]) for node in violation['nodes'][:4]]}"
        for violation in found
        if violation["impact"] in impacts
    ]
