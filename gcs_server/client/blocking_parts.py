"""The same client for programs without an event loop: `with SyncGcs() as gcs`.

Each call runs its asynchronous twin on a loop of its own thread and waits for it.
Made by tools/build_sync_client.py from the asynchronous client: change that, then run `make types`.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from typing import Any

from anyio.from_thread import BlockingPortal

from gcs_server.client import (
    control,
    gimbal,
    group,
    mission,
    offboard,
    offboard_mission,
)
from gcs_server.client.control import OnLost
from gcs_server.client.group import Setpoints
from gcs_server.client.mission import TRANSFER_S
from gcs_server.client.offboard import Answer, Steering
from gcs_server.client.plans import Plan
from gcs_server.client.setpoints import Body, PathPoints


class SyncControl:
    """A vehicle's `control`; each call answers how it then stands (`holder`, `yours`, `requests`, …)."""

    def __init__(self, inner: control.Control, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal

    def show(self) -> dict[str, Any]:
        """The holder, since when, and the requests."""
        return self._portal.call(lambda: self._inner.show())

    def take(self, *, force: bool = False, on_expiry: OnLost | None = None) -> dict[str, Any]:
        """Takes control.

        Args:
            force: from another client, after it denied a request, did not answer, or because it cannot be
                asked.
            on_expiry: command sent to the flying vehicle if this program is silent for `lease_s`.

        Raises:
            NotInControl: another has it.
            Refused: forced without asking first.
        """
        return self._portal.call(lambda: self._inner.take(force=force, on_expiry=on_expiry))

    def request(self, reason: str | None = None, *, wait_s: float = 0.0) -> dict[str, Any]:
        """Requests control from the holder; `wait_s` is how long to wait for the answer.

        Raises:
            NotInControl: denied, or not answered within `wait_s`.
        """
        return self._portal.call(lambda: self._inner.request(reason, wait_s=wait_s))

    def grant(self, client: str) -> dict[str, Any]:
        """Gives control to a client that requested it, by key or name."""
        return self._portal.call(lambda: self._inner.grant(client))

    def deny(self, client: str, reason: str | None = None) -> dict[str, Any]:
        """Denies a request; the denied client may then take control by force."""
        return self._portal.call(lambda: self._inner.deny(client, reason))

    def release(self) -> dict[str, Any]:
        """Releases control; the flight is not changed."""
        return self._portal.call(lambda: self._inner.release())

    @contextmanager
    def held(self, *, force: bool = False, on_expiry: OnLost | None = None) -> Generator[dict[str, Any]]:
        """Holds control inside a block: renewed while the program runs, released at the end."""
        with self._portal.wrap_async_context_manager(
            self._inner.held(force=force, on_expiry=on_expiry)
        ) as found:
            yield found


class SyncGimbal:
    """The vehicle's gimbal; angles in degrees, pitch up positive."""

    def __init__(self, inner: gimbal.Gimbal, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal

    def at(self, *, component: int | None = None, device: int | None = None) -> SyncGimbal:
        """Another gimbal of the vehicle; `gimbals` of the topic `gimbal` lists them.

        Args:
            component: MAVLink component of its manager (`component_id`).
            device: its `gimbal_device_id`, where a manager has several.
        """
        return SyncGimbal(self._inner.at(component=component, device=device), self._portal)

    def take(self) -> None:
        """Takes control."""
        self._portal.call(lambda: self._inner.take())

    def release(self) -> None:
        """Gives control back."""
        self._portal.call(lambda: self._inner.release())

    def angles(
        self, pitch_deg: float, yaw_deg: float, *, roll_deg: float | None = None, yaw_lock: bool = False
    ) -> dict[str, Any] | None:
        """Points it; yaw from the nose, from north with `yaw_lock`.

        Returns:
            Where a limit stopped it (`limited` of the answer); None if it points as commanded.
        """
        return self._portal.call(
            lambda: self._inner.angles(pitch_deg, yaw_deg, roll_deg=roll_deg, yaw_lock=yaw_lock)
        )

    def rates(self, pitch_rate_deg_s: float, yaw_rate_deg_s: float, *, yaw_lock: bool = False) -> None:
        """Turns it at constant rates until the next command; zeros stop both axes."""
        self._portal.call(lambda: self._inner.rates(pitch_rate_deg_s, yaw_rate_deg_s, yaw_lock=yaw_lock))

    def roi(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        """Keeps looking at a place."""
        self._portal.call(lambda: self._inner.roi(lat_deg, lon_deg, alt_amsl_m))

    def clear_roi(self) -> None:
        """Stops looking at a place."""
        self._portal.call(lambda: self._inner.clear_roi())


class SyncGroup:
    """A group that flies.

    Args:
        gcs: the client.
        started: what the server answered to its start.
        life: how long setpoints count, and what follows.
    """

    def __init__(self, inner: group.Group, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal
        self.id = self._inner.id
        self.started = self._inner.started

    def send(self, setpoints: Setpoints) -> dict[str, Any]:
        """New setpoints for some members or all, sent at one instant; those of the others are renewed.

        Raises:
            Invalid: a value is not acceptable, or a vehicle is not in the group.
            Refused: one cannot be flown, two would come too near, or the group has ended.
        """
        return self._portal.call(lambda: self._inner.send(setpoints))

    def renew(self) -> dict[str, Any]:
        """Renews all setpoints for another `valid_for_s`; raises as `send`."""
        return self._portal.call(lambda: self._inner.renew())

    def status(self) -> dict[str, Any]:
        """State, members, the two that are nearest, findings, why it ended."""
        return self._portal.call(lambda: self._inner.status())

    def hold(self) -> dict[str, Any]:
        """Puts all members that still fly it into Hold; nothing happens where it has ended."""
        return self._portal.call(lambda: self._inner.hold())


class SyncMission:
    """The mission, geofence and rally points of a vehicle."""

    def __init__(self, inner: mission.Mission, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal

    def state(self) -> dict[str, Any]:
        """Where the vehicle is in its mission, and which plan it `holds`."""
        return self._portal.call(lambda: self._inner.state())

    def upload(
        self,
        plan: Plan | None = None,
        *,
        plan_id: str | None = None,
        version: int | None = None,
        confirm: str | None = None,
        timeout_s: float = TRANSFER_S,
    ) -> dict[str, Any]:
        """Uploads a plan, given or stored on the server, and verifies it; returns the result.

        `confirm` is needed while the vehicle flies Mission: `vehicle {id} flies the new mission at once`.

        Raises:
            Refused: the vehicle refuses an item, or holds something else afterwards; says what it holds.
        """
        return self._portal.call(
            lambda: self._inner.upload(
                plan, plan_id=plan_id, version=version, confirm=confirm, timeout_s=timeout_s
            )
        )

    def download(self, *, timeout_s: float = TRANSFER_S) -> dict[str, Any]:
        """Reads what the vehicle holds; as `plan`."""
        return self._portal.call(lambda: self._inner.download(timeout_s=timeout_s))

    def plan(self) -> dict[str, Any]:
        """What was read or verified last: `plan`, `read_unix_s`, `still_held`."""
        return self._portal.call(lambda: self._inner.plan())

    def compare(
        self, plan: Plan | None = None, *, plan_id: str | None = None, version: int | None = None
    ) -> dict[str, Any]:
        """Whether a plan is `equal` to what was read last, and the `differences`."""
        return self._portal.call(lambda: self._inner.compare(plan, plan_id=plan_id, version=version))

    def clear(self) -> None:
        """Clears mission, geofence and rally points on the vehicle; refused while it flies Mission."""
        self._portal.call(lambda: self._inner.clear())

    def start(self, item: int | None = None, *, despite: Sequence[str] = ()) -> None:
        """Flies it, from an item (counted from 0) or the current one; arms where needed.

        Raises:
            Refused: the plan has errors, or is not known, and `despite` does not name their codes.
        """
        self._portal.call(lambda: self._inner.start(item, despite=despite))

    def resume(self) -> None:
        """Resumes in flight from the current item; `vehicle.hold()` pauses."""
        self._portal.call(lambda: self._inner.resume())


class SyncOffboard(Steering[Answer]):
    """A running stream.

    Args:
        vehicle: whose.
        started: what the server answered to its start.
        life: how long each setpoint counts, and what follows.
    """

    def __init__(self, inner: offboard.Offboard, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal
        self.started = self._inner.started

    def send(self, body: Body) -> Answer:
        """Sends any setpoint body; returns the stream's state.

        Raises:
            Invalid: a value is not acceptable.
            Refused: it cannot be flown, or no stream runs any more.
        """
        return self._portal.call(lambda: self._inner.send(body))

    def follow_path(self, points: PathPoints) -> None:
        """Flies a curve through points in time and returns at its end; its last point is then held.

        Raises:
            Timeout: another setpoint, mode or client has ended it.
        """
        self._portal.call(lambda: self._inner.follow_path(points))

    @contextmanager
    def live(self) -> Generator[SyncLiveOffboard]:
        """Setpoints over a WebSocket, at up to 100 Hz; the stream goes on at the block's end.

        Yields:
            The same calls; each returns once the server has answered.
        """
        with self._portal.wrap_async_context_manager(self._inner.live()) as found:
            yield SyncLiveOffboard(found, self._portal)

    def status(self) -> Answer:
        """Rate achieved, age of the setpoint, validity left; limits, failsafe, what can be flown."""
        return self._portal.call(lambda: self._inner.status())

    def stop(self) -> None:
        """Ends the stream in Hold; does nothing if it has ended already."""
        self._portal.call(lambda: self._inner.stop())


class SyncLiveOffboard(Steering[Answer]):
    """Setpoints over a WebSocket."""

    def __init__(self, inner: offboard.LiveOffboard, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal

    def send(self, body: Body) -> Answer:
        """Sends any setpoint body; returns what was `applied`, and what `limited` it.

        Raises:
            Invalid, Refused: as over HTTP; the socket stays open.
            Unreachable: the server has gone.
        """
        return self._portal.call(lambda: self._inner.send(body))


class SyncOffboardMission:
    """The offboard mission of a vehicle: started, watched, steered. `then` of `abort`: hold, return or land.

    It goes on while the program is away; what it does when nobody has control any more stands in its
    document (`actions.control_lost`, `hold` unless given).
    """

    def __init__(self, inner: offboard_mission.OffboardMission, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal

    def state(self) -> dict[str, Any] | None:
        """How the newest one stands (as the topic `offboard_mission`); None: there has been none."""
        return self._portal.call(lambda: self._inner.state())

    def flown(self) -> dict[str, Any]:
        """The newest one as it was flown: `samples` with place and sent place, `deviation_mean_m`, …"""
        return self._portal.call(lambda: self._inner.flown())

    def start(
        self,
        mission: Plan | None = None,
        *,
        plan_id: str | None = None,
        version: int | None = None,
        dry_run: str | None = None,
        despite: Sequence[str] = (),
    ) -> dict[str, Any]:
        """Flies a mission's document, or one that the server keeps; arms and takes off where it says so.

        With the id of a dry run of several flights the server tells when the vehicle leaves its corridor.

        Raises:
            Refused: it has errors that `despite` does not name, or an estimate is missing.
        """
        return self._portal.call(
            lambda: self._inner.start(
                mission, plan_id=plan_id, version=version, dry_run=dry_run, despite=despite
            )
        )

    def pause(self) -> dict[str, Any]:
        """Stands still on its path."""
        return self._portal.call(lambda: self._inner.pause())

    def resume(self) -> dict[str, Any]:
        """Goes on, from wherever the vehicle is."""
        return self._portal.call(lambda: self._inner.resume())

    def skip(self) -> dict[str, Any]:
        """Leaves the present step out."""
        return self._portal.call(lambda: self._inner.skip())

    def go_on(self) -> dict[str, Any]:
        """Answers a wait for a person."""
        return self._portal.call(lambda: self._inner.go_on())

    def abort(self, then: str = "hold") -> dict[str, Any]:
        """Ends it; the vehicle holds, returns or lands."""
        return self._portal.call(lambda: self._inner.abort(then))
