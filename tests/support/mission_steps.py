"""A mission in the middle of each kind of step, for tests of events during that step."""

from __future__ import annotations

from tests.support.mission_vehicle import FlownMission
from tests.support.offboard_missions import flown, mission

CENTER = "center: {offset_ned_m: [20, 0, -10]}, radius_m: 8"
FLY = "step: fly, points: [{offset_ned_m: [30, 0, -10]}]"
STEPS = {
    "take_off": None,
    "fly": "step: fly, points: [{offset_ned_m: [40, 0, -10]}, {offset_ned_m: [40, 30, -14]}]",
    "hold": "step: hold, duration_s: 10",
    "orbit": f"step: orbit, {CENTER}",
    "helix": f"step: helix, {CENTER}, climb_m: 5",
    "spiral": f"step: spiral, {CENTER}, end_radius_m: 15",
    "figure_eight": "step: figure_eight, center: {offset_ned_m: [0, 0, -10]}, length_m: 40, width_m: 20",
    "velocity": "step: velocity, velocity_ned_m_s: [2, 1, 0], duration_s: 12",
    "attitude": "step: attitude, thrust: 0.5, duration_s: 10",
    "photo": "step: photo, count: 20, interval_s: 1",
    "person": "step: wait, until: person, timeout_s: 60, message: Sharp?",
    "condition": "step: wait, until: {value: satellites, above: 10}, timeout_s: 60",
    "repeat": f"step: repeat, times: 2, steps: [{{{FLY}}}, {{step: hold, duration_s: 8}}]",
    "land": None,
}
IN_OFFBOARD = [kind for kind in STEPS if kind not in ("take_off", "land")]


def flight(kind: str, **actions: str) -> FlownMission:
    """A mission in the middle of a step of this kind."""
    wanted = STEPS[kind] or "step: hold, duration_s: 4"
    document = mission(flown(wanted, FLY))
    document = document.model_copy(update={"actions": document.actions.model_copy(update=actions)})
    fake = FlownMission(document).start()
    if kind in ("take_off", "land"):
        state = "taking_off" if kind == "take_off" else "landing"
        return fake.until(lambda: fake.status.state == state and fake.reading.landed == "in_air").fly(1.0)
    fake.until(lambda: fake.status.state in ("flying", "waiting") and str(fake.status.place)[:6] == "step 2")
    return fake.fly(2.5)


def asks_nothing(fake: FlownMission, for_s: float = 5.0) -> None:
    """Flies for this time and checks that nothing is requested or sent."""
    asked, sent = len(fake.asked), len(fake.sent)
    fake.fly(for_s)
    assert fake.asked[asked:] == []
    assert len(fake.sent) == sent
