"""The page by keyboard alone: each control is reached, and only its own slider confirms a question."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Callable, Iterator

import pytest
from playwright.sync_api import Browser, Locator, Page, Route, expect

from gcs_server.client import SyncGcs
from tests.e2e.browser import REPOSITORY, chromium, in_both_themes, opened
from tests.e2e.fast_station import FAST, Station
from tests.station import free_port, server, vehicle, wait_until
from tools import build_page

pytestmark = pytest.mark.browser

MOST_STOPS = 300
STOPS_AT_ONCE = 20
MOST_PANELS = 6
LONGER_THAN_A_GLANCE_MS = 150
LONGER_THAN_ANY_HOLD_MS = 2_000
A_FEW_SECONDS_MS = 2_500
NOT_PRESSED = ("Reload", "Hold")
"""Hold asks nobody, and ends every question."""

WALK = """
() => {
  if (!window.walked) document.addEventListener('focusin', (e) => window.walked.add(e.target));
  window.walked = new Set();
  document.activeElement.blur();
}
"""
UNREACHED = """
() => [...document.querySelectorAll(
    'a[href], button, input, select, textarea, summary, [tabindex], [role="slider"], [role="button"]')]
  .filter((one) => !one.disabled && one.tabIndex >= 0 && one.checkVisibility({ visibilityProperty: true })
    && one.closest('[aria-hidden="true"], [inert]') === null && !window.walked.has(one)
    && !(one.type === 'radio'))
  .map((one) => one.outerHTML.slice(0, 140))
"""
WITHOUT_A_NAME = """
() => [...window.walked].filter((one) => one.isConnected && one !== document.body && one.tabIndex >= 0
    && !(one.ariaLabel || one.textContent.trim() || one.title || one.labels?.length))
  .map((one) => one.outerHTML.slice(0, 140))
"""
AT = """
() => document.activeElement.dataset.stop ??= String(window.stops = (window.stops ?? 0) + 1)
"""
HAS_FOCUS = "(dialog) => dialog.contains(document.activeElement)"
CONTROLS = """
(dialog) => [...dialog.querySelectorAll('button, input, select, textarea, a[href], [tabindex]')]
  .filter((one) => !one.disabled && one.tabIndex >= 0 && one.checkVisibility()).length
"""
BUTTONS = """
() => [...new Set([...document.querySelectorAll('button')]
  .filter((one) => !one.disabled && one.ariaDisabled !== 'true' && one.checkVisibility())
  .map((one) => one.ariaLabel ?? one.textContent.replace(/\\s+/g, ' ').trim()))]
"""
DESCRIBED = """
(dialog) => [dialog.getAttribute('aria-modal') === 'true' ? 'modal' : '',
  ...['aria-labelledby', 'aria-describedby'].map((a) => document.getElementById(dialog.getAttribute(a)))
    .map((one) => one?.innerText ?? '')]
"""
FOCUS_OUTSIDE = "() => [...document.querySelectorAll('.dock button')].at(-1).focus()"
ELSEWHERE = ("body", "[role=alertdialog] [aria-label=Cancel]", ".dock button:last-child")
HELD_ELSEWHERE = """
([where, key, held_ms]) => new Promise((done) => {
  const knob = document.querySelector('[role=alertdialog] [role=slider]');
  const code = key === ' ' ? 'Space' : key;
  const send = (on, type, key, repeat) =>
    on?.dispatchEvent(new KeyboardEvent(type, { key, code, repeat, bubbles: true, cancelable: true }));
  send(knob, 'keydown', 'Home', false);
  send(document.querySelector(where), 'keydown', key, false);
  setTimeout(() => {
    send(document.querySelector(where), 'keydown', key, true);
    requestAnimationFrame(() => done(knob.isConnected ? knob.ariaValueNow : 'closed'));
  }, held_ms);
})
"""
"""A key that goes down on what does not confirm, wherever the focus is, and is not let go."""
TICKING = """
(wait_ms) => new Promise((done) => {
  const said = [];
  const live = ['status', 'alert', 'log', 'timer'].map((role) => `[role="${role}"]`)
    .concat('[aria-live="polite"]', '[aria-live="assertive"]').join();
  const watcher = new MutationObserver((changes) => {
    for (const change of changes) {
      const at = change.target.nodeType === 3 ? change.target.parentElement : change.target;
      const region = at?.closest(live);
      if (!region || at.closest('[aria-live="off"]') || at.closest('[aria-hidden="true"]')) continue;
      if (region.getAttribute('aria-relevant') === 'additions' && change.type === 'characterData') continue;
      said.push(region.outerHTML.slice(0, 160));
    }
  });
  watcher.observe(document.body, { subtree: true, childList: true, characterData: true });
  setTimeout(() => { watcher.disconnect(); done([...new Set(said)]); }, wait_ms);
})
"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One Chromium for all of them; the page is built first if it is older than its sources."""
    build_page.build(REPOSITORY)
    with chromium() as one:
        yield one


@pytest.fixture(scope="module")
def port() -> int:
    """Where the vehicles send to."""
    return free_port()


@pytest.fixture(scope="module")
def vehicles(port: int) -> Iterator[int]:
    """The process group of two vehicles, so that the room for groups is there too; 101 is flown."""
    with vehicle(port, instances=2, more=FAST) as process:
        yield process.pid


@pytest.fixture(scope="module")
def field(port: int, vehicles: int) -> Iterator[Station]:
    """One station for all."""
    assert vehicles
    with server([f"udpin://127.0.0.1:{port}"]) as (url, _), SyncGcs(url, client="e2e") as gcs:
        drone = gcs.wait_for_vehicle("101", ready=True, timeout_s=120)
        gcs.wait_for_vehicle("102", ready=True, timeout_s=120)
        yield Station(url, gcs, drone)


@pytest.fixture
def flying(field: Station) -> Station:
    """The station with its vehicle in Hold, in the air."""
    if not field.drone.status()["armed"]:
        field.drone.takeoff(6)
    field.drone.hold()
    field.drone.until(lambda v: v["status"]["mode"] == "hold", what="Hold in the air")
    return field


def walk(page: Page, way: str) -> None:
    """Tab through all of the page; every control that is seen is reached and has a name."""
    page.evaluate(WALK)
    for _ in range(0, MOST_STOPS, STOPS_AT_ONCE):
        before = page.evaluate("() => window.walked.size")
        for _ in range(STOPS_AT_ONCE):
            page.keyboard.press(way)
        if page.evaluate("() => window.walked.size") == before:
            break  # it has come round
    else:
        pytest.fail(f"{MOST_STOPS} times {way} do not come round")
    assert page.evaluate(UNREACHED) == []
    assert page.evaluate(WITHOUT_A_NAME) == []


def rooms(page: Page) -> list[tuple[str, Callable[[], None]]]:
    """Every room and panel, and how it is opened by keys."""

    def way(name: str) -> Callable[[], None]:
        def choose() -> None:
            page.get_by_label("How setpoints are given").get_by_role("button", name=name, exact=True).focus()
            page.keyboard.press("Enter")

        return choose

    def flights() -> None:
        page.get_by_role("button", name="Recorded flights", exact=True).focus()
        page.keyboard.press("Enter")
        flights = page.get_by_role("region", name="Recorded flights")
        flights.get_by_role("list").or_(flights.get_by_text("Nothing is recorded")).first.wait_for()

    def menu() -> None:
        place = page.get_by_role("dialog", name="At this place")

        def opened_here() -> bool:
            page.get_by_role("application", name="Map from above").focus()
            page.keyboard.press("Shift+ArrowUp")  # not on a vehicle
            page.keyboard.press("Enter")
            return place.is_visible()

        wait_until(opened_here, "the menu at a place")

    def key(character: str) -> Callable[[], None]:
        return lambda: page.keyboard.press(character)

    keys = {"messages": "n", "values": "v", "readiness": "y", "parameters": "i", "control": "c", "help": "?"}
    keys["vehicles"] = "j"
    parts = [(f"room: {name}", way(name)) for name in ("Form", "Drag in 3D", "Gamepad", "Group")]
    return [
        ("fly", lambda: None),
        *((name, key(character)) for name, character in keys.items()),
        ("flights", flights),
        ("spot menu", menu),
        ("room", key("p")),
        *parts,
    ]


def close_all(page: Page) -> None:
    """Escape closes one after the other."""
    for _ in range(MOST_PANELS):
        page.keyboard.press("Escape")


def test_every_control_of_every_room_is_reached_by_tab_and_has_a_name(
    browser: Browser, flying: Station
) -> None:
    with opened(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        for name, open_it in rooms(page):
            open_it()
            page.wait_for_timeout(50)
            try:
                walk(page, "Shift+Tab" if name == "fly" else "Tab")
            except AssertionError as error:
                raise AssertionError(f"in {name}: {error}") from error
            if not name.startswith("room"):
                close_all(page)


def refuse_commands(page: Page) -> list[str]:
    """From now on no command of the page reaches the server; answers those that it gave."""
    commands: list[str] = []
    asks_only = re.compile("/scene/|/readiness/check|/params/refresh")

    def answer(route: Route) -> None:
        if route.request.method == "GET" or asks_only.search(route.request.url):
            route.fallback()
            return
        commands.append(route.request.url)
        problem = {"title": "Not in this test", "detail": "No command is sent.", "code": "refused"}
        route.fulfill(status=409, content_type="application/problem+json", json=problem)

    page.route("**/api/v1/**", answer)
    return commands


class Question:
    """An open confirmation, and what must hold for each."""

    def __init__(self, page: Page, commands: list[str]) -> None:
        self.page, self.commands = page, commands
        self.dialog = page.get_by_role("alertdialog")
        self.knob = self.dialog.get_by_role("slider")
        self.title = self.dialog.get_by_role("heading").inner_text()
        self._ask: Callable[[], None] = lambda: None

    def check(self, ask: Callable[[], None]) -> None:
        """Everything but its own slider leaves it unconfirmed; `ask` opens it again."""
        self._ask = ask
        self._announces_itself()
        self._keeps_the_keyboard()
        self._heeds_no_key_elsewhere()
        self._is_cancelled_by_its_button_and_by_escape()
        assert self.commands == [], f"{self.title}: sent without being confirmed"
        self._is_confirmed_on_its_slider()

    def open(self) -> None:
        """Asks anew where it was cancelled or has expired; just after that a press counts as one too late."""

        def asked() -> bool:
            if not self.dialog.is_visible():
                self._ask()
            return self.dialog.is_visible()

        wait_until(asked, f"the question {self.title!r}")

    def _announces_itself(self) -> None:
        self.open()
        expect(self.knob, self.title).to_be_focused()
        named = self.dialog.evaluate(DESCRIBED)
        assert all(text.strip() for text in named), (self.title, named)

    def _keeps_the_keyboard(self) -> None:
        for key in ("Tab", "Shift+Tab"):
            self.open()
            controls = self.dialog.evaluate(CONTROLS)
            reached: set[str] = set()
            for _ in range(controls + 1):
                self.page.keyboard.press(key)
                assert self.dialog.evaluate(HAS_FOCUS), f"{self.title}: {key} leaves it"
                reached.add(self.page.evaluate(AT))
            assert len(reached) == controls, f"{self.title}: {key} goes round in it"
        self.open()
        self.page.evaluate(FOCUS_OUTSIDE)
        wait_until(lambda: self.dialog.evaluate(HAS_FOCUS), "the keyboard's return into the question")

    def _heeds_no_key_elsewhere(self) -> None:
        for where in ELSEWHERE:
            for key in (" ", "Enter"):
                self.open()
                now = self.page.evaluate(HELD_ELSEWHERE, [where, key, LONGER_THAN_A_GLANCE_MS])
                assert now == "0", f"{self.title}: {key!r} held on {where} moves it to {now}"

    def _is_cancelled_by_its_button_and_by_escape(self) -> None:
        for key in ("Enter", "Space"):
            self.open()
            self.dialog.get_by_role("button", name="Cancel").focus()
            self.page.keyboard.down(key)
            self.page.wait_for_timeout(LONGER_THAN_A_GLANCE_MS)
            self.page.keyboard.down(key)  # the keyboard repeats
            self.page.keyboard.up(key)
            expect(self.dialog, f"{self.title}: {key} on Cancel").to_be_hidden()
        self.open()
        for key in ("Space", "Enter", "End", "PageUp"):
            self.knob.press(key)  # let go at once
        expect(self.knob, self.title).to_have_attribute("aria-valuenow", "0")
        self.page.keyboard.press("Escape")
        expect(self.dialog, f"{self.title}: Escape").to_be_hidden()

    def _is_confirmed_on_its_slider(self) -> None:
        self.open()
        expect(self.knob).to_be_focused()
        self.page.keyboard.down("Space")
        expect(self.dialog, f"{self.title}: Space held on its slider").to_be_hidden()
        for _ in range(3):
            self.page.keyboard.down("Space")  # the keyboard repeats, now with the focus on another button
        self.page.keyboard.up("Space")
        wait_until(lambda: self.commands, f"the command of {self.title!r}")
        expect(self.dialog, f"{self.title}: asks again by the same press").to_be_hidden()
        assert len(self.commands) == 1, (self.title, self.commands)
        self.commands.clear()


def press_new_buttons(page: Page, pressed: set[str], where: str) -> Iterator[tuple[str, Callable[[], None]]]:
    """Enter on each button in sight that was not pressed before; those that ask, and how they ask again."""
    dialog = page.get_by_role("alertdialog")
    for name in page.evaluate(BUTTONS):
        named = re.sub(r"\d+", r"\\d+", re.escape(name)).replace("/", ".")  # some count
        button = page.get_by_role("button", name=re.compile(f"^{named}")).first  # and what it adds later
        if named in pressed or not button.is_visible() or button.is_disabled():
            continue
        pressed.add(named)

        def ask(button: Locator = button) -> None:
            button.focus()
            page.keyboard.press("Enter")

        ask()
        page.wait_for_timeout(20)
        if dialog.is_visible():
            yield f"{name!r} in {where}", ask


def test_each_question_of_each_button_is_confirmed_by_its_own_slider_only(
    browser: Browser, flying: Station
) -> None:
    asked: dict[str, str] = {}
    with opened(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        commands = refuse_commands(page)
        # in the air everything; on the ground what is other there
        for vehicle_key, some in (("1", None), ("2", 1)):
            pressed: set[str] = {*NOT_PRESSED}
            for room, open_it in rooms(page)[:some]:
                close_all(page)
                page.keyboard.press(vehicle_key)
                open_it()
                page.wait_for_timeout(50)
                for where, ask in press_new_buttons(page, pressed, room):
                    question = Question(page, commands)
                    commands.clear()  # of the buttons before, which ask nothing
                    if asked.setdefault(question.title, where) == where:
                        question.check(ask)
                    else:
                        page.keyboard.press("Escape")
    for wanted in ("Disarm", "Arm", "Take off", "Land", "Return", "Offboard", "Send", "Stop motors"):
        assert any(title.startswith(wanted) for title in asked), (wanted, asked)
    assert flying.drone.status()["armed"]


@pytest.mark.parametrize("key", ["Space", "Enter"])
def test_a_key_held_on_cancel_stops_no_motors(browser: Browser, flying: Station, key: str) -> None:
    with opened(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        commands = refuse_commands(page)
        page.keyboard.press("Shift+K")
        dialog = page.get_by_role("alertdialog")
        dialog.get_by_role("button", name="Cancel").focus()
        for _ in range(5):  # the keyboard repeats
            page.keyboard.down(key)
            page.wait_for_timeout(LONGER_THAN_ANY_HOLD_MS / 5)
        page.keyboard.up(key)
        expect(dialog).to_be_hidden()
        assert commands == []


def test_hold_works_after_a_checkbox_a_list_and_a_slider_were_used(browser: Browser, flying: Station) -> None:
    drone = flying.drone
    with opened(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        commands = refuse_commands(page)
        page.keyboard.press("p")
        room = page.get_by_role("region", name="Offboard room")
        box = room.get_by_role("checkbox", name="Renew it while this page is open")
        box.focus()
        page.keyboard.press("Space")
        page.keyboard.press("h")
        wait_until(lambda: commands, "Hold after a checkbox")
        assert commands.pop().endswith("/vehicles/101/hold")

        room.locator("summary").first.press("Enter")
        choice = room.get_by_label("It shall")
        choice.focus()
        before = choice.input_value()
        page.keyboard.press("h")
        wait_until(lambda: commands, "Hold on a list")
        assert commands.pop().endswith("/vehicles/101/hold")
        assert choice.input_value() == before

        field = room.get_by_label("Good for, seconds")
        field.press("h")
        assert commands == []  # a text is typed there

        # switched off there is no key but Escape; the page says so, and the setting outlives it
        page.keyboard.press("Escape")
        page.get_by_role("button", name="Fly", exact=True).press("Enter")
        page.keyboard.press("?")
        page.get_by_role("checkbox", name="Single-key shortcuts").press("Space")
        expect(page.get_by_role("status").filter(has_text="H does not hold")).to_be_visible()
        assert in_both_themes(page) == []
        page.keyboard.press("Escape")
        page.reload()
        expect(page.locator(".pill b")).to_have_text("Holding")
        off = page.get_by_role("button", name="Keys off")
        expect(off).to_contain_text("Keys off")
        for key in ("h", "t", "Shift+K", "?", "1"):
            page.keyboard.press(key)
        expect(page.get_by_role("alertdialog")).to_have_count(0)
        off.press("Enter")
        page.get_by_role("checkbox", name="Single-key shortcuts").press("Space")
        page.keyboard.press("h")
        wait_until(lambda: commands, "Hold, switched on again")
    assert drone.status()["armed"]


def test_the_gimbal_is_pointed_by_arrow_keys(browser: Browser, flying: Station) -> None:
    with opened(browser, flying.url, scene=False) as page:
        card = page.get_by_label("Gimbal", exact=True)
        card.get_by_role("button", name="Take").press("Enter")
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

        wait_until(lambda: pitch_rad() < -0.3, "the camera turned by keys")
        card.get_by_role("button", name="Release").press("Enter")


def test_nothing_that_only_counts_is_said_aloud(browser: Browser, flying: Station, vehicles: int) -> None:
    drone = flying.drone
    with opened(browser, flying.url, scene=False) as page:
        expect(page.locator(".pill b")).to_have_text("Holding")
        start: dict[str, object] = {
            "setpoint": {"type": "position", "position_ned_m": [0, 0, -6]},
            "valid_for_s": 60,
        }
        drone.request("POST", "/offboard/start", start)
        expect(page.locator(".pill b")).to_have_text("Offboard")
        for open_it in (lambda: None, lambda: page.keyboard.press("p"), lambda: page.keyboard.press("y")):
            open_it()
            page.wait_for_timeout(500)
            assert page.evaluate(TICKING, A_FEW_SECONDS_MS) == []
        drone.hold()
        os.killpg(vehicles, signal.SIGSTOP)
        try:
            expect(page.locator(".pill b")).to_have_text("Connection lost")
            expect(page.get_by_role("button", name=re.compile("^101"))).to_contain_text("lost")
            page.wait_for_timeout(500)
            assert page.evaluate(TICKING, A_FEW_SECONDS_MS) == []
        finally:
            os.killpg(vehicles, signal.SIGCONT)
        expect(page.locator(".pill b")).not_to_have_text("Connection lost")
