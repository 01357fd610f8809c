"""The same client for programs without an event loop: `with SyncGcs() as gcs`.

Each call runs the asynchronous call in an event loop on a separate thread, and waits for its result.
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
from gcs_server.client.control import OnControlLost
from gcs_server.client.group import Setpoints
from gcs_server.client.mission import TRANSFER_TIMEOUT_S
from gcs_server.client.offboard import Response, SetpointCalls
from gcs_server.client.plans import Plan
from gcs_server.client.setpoints import Body, PathPoints


class SyncControl:
    """A vehicle's `control`; each call returns the state of control (`holder`, `yours`, `requests`, …)."""

    def __init__(self, inner: control.Control, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal

    def show(self) -> dict[str, Any]:
        """The client in control, since when, and the requests."""
        return self._portal.call(lambda: self._inner.show())

    def take(self, *, force: bool = False, on_expiry: OnControlLost | None = None) -> dict[str, Any]:
        """Takes control.

        Args:
            force: take control from another client that denied the request, did not answer it, or cannot
                receive requests.
            on_expiry: command sent to the flying vehicle if this program sends nothing for `lease_s`.

        Raises:
            NotInControl: another client has control.
            Refused: `force` was used without an earlier request.
        """
        return self._portal.call(lambda: self._inner.take(force=force, on_expiry=on_expiry))

    def request(self, reason: str | None = None, *, wait_s: float = 0.0) -> dict[str, Any]:
        """Requests control from the client that has it, and waits up to `wait_s` for the answer.

        Raises:
            NotInControl: the request was denied, or not answered within `wait_s`.
        """
        return self._portal.call(lambda: self._inner.request(reason, wait_s=wait_s))

    def grant(self, client: str) -> dict[str, Any]:
        """Gives control to a client that requested it, by key or name."""
        return self._portal.call(lambda: self._inner.grant(client))

    def deny(self, client: str, reason: str | None = None) -> dict[str, Any]:
        """Denies a request; the denied client may then take control by force."""
        return self._portal.call(lambda: self._inner.deny(client, reason))

    def release(self) -> dict[str, Any]:
        """Releases control; the flight does not change."""
        return self._portal.call(lambda: self._inner.release())

    @contextmanager
    def held(
        self, *, force: bool = False, on_expiry: OnControlLost | None = None
    ) -> Generator[dict[str, Any]]:
        """Keeps control inside a block: control is renewed while the program runs and released at the end."""
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
        """Selects another gimbal of the vehicle; the topic `gimbal` lists them in `gimbals`.

        Args:
            component: MAVLink component id of the gimbal manager (`component_id`).
            device: `gimbal_device_id`, if the gimbal manager has several gimbals.
        """
        return SyncGimbal(self._inner.at(component=component, device=device), self._portal)

    def take(self) -> None:
        """Takes control of the gimbal."""
        self._portal.call(lambda: self._inner.take())

    def release(self) -> None:
        """Releases control of the gimbal."""
        self._portal.call(lambda: self._inner.release())

    def angles(
        self, pitch_deg: float, yaw_deg: float, *, roll_deg: float | None = None, yaw_lock: bool = False
    ) -> dict[str, Any] | None:
        """Points the gimbal; yaw is relative to the nose, or to north with `yaw_lock`.

        Returns:
            The angles at which a limit stopped the gimbal (`limited` of the response); None if it reached the
            commanded angles.
        """
        return self._portal.call(
            lambda: self._inner.angles(pitch_deg, yaw_deg, roll_deg=roll_deg, yaw_lock=yaw_lock)
        )

    def rates(self, pitch_rate_deg_s: float, yaw_rate_deg_s: float, *, yaw_lock: bool | None = None) -> None:
        """Turns the gimbal at constant rates until the next command; zeros stop both axes. `yaw_lock` None
        keeps the gimbal's current setting.
        """
        self._portal.call(lambda: self._inner.rates(pitch_rate_deg_s, yaw_rate_deg_s, yaw_lock=yaw_lock))

    def roi(self, lat_deg: float, lon_deg: float, alt_amsl_m: float) -> None:
        """Keeps the camera pointed at a location."""
        self._portal.call(lambda: self._inner.roi(lat_deg, lon_deg, alt_amsl_m))

    def clear_roi(self) -> None:
        """Stops pointing at a location."""
        self._portal.call(lambda: self._inner.clear_roi())


class SyncGroup:
    """A flying group.

    Args:
        gcs: the client.
        started: the server's response to the start.
        validity: validity of the setpoints, and the action on expiry.
    """

    def __init__(self, inner: group.Group, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal
        self.id = self._inner.id
        self.started = self._inner.started

    def send(self, setpoints: Setpoints) -> dict[str, Any]:
        """Sends new setpoints to some or all members at the same time, and renews the setpoints of the other
        members.

        Raises:
            Invalid: a value is invalid, or a vehicle is not in the group.
            Refused: a setpoint cannot be flown, two vehicles would come too close, or the group has ended.
        """
        return self._portal.call(lambda: self._inner.send(setpoints))

    def renew(self) -> dict[str, Any]:
        """Renews all setpoints for another `valid_for_s`; raises the same errors as `send`."""
        return self._portal.call(lambda: self._inner.renew())

    def status(self) -> dict[str, Any]:
        """State, members, the two closest members, findings, and the reason for the end."""
        return self._portal.call(lambda: self._inner.status())

    def hold(self) -> dict[str, Any]:
        """Puts all current members into Hold; does nothing if the group has ended."""
        return self._portal.call(lambda: self._inner.hold())


class SyncMission:
    """The mission, geofence and rally points of a vehicle."""

    def __init__(self, inner: mission.Mission, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal

    def state(self) -> dict[str, Any]:
        """Progress of the vehicle's mission, the plan on the vehicle (`holds`), and where an interrupted
        flight can be resumed (`resume`).
        """
        return self._portal.call(lambda: self._inner.state())

    def upload(
        self,
        plan: Plan | None = None,
        *,
        plan_id: str | None = None,
        version: int | None = None,
        hold_first: bool = False,
        despite: Sequence[str] = (),
        timeout_s: float = TRANSFER_TIMEOUT_S,
    ) -> dict[str, Any]:
        """Uploads a plan (a document, or one stored on the server), verifies it, and returns the result.

        A vehicle in Mission mode flies to the first item of a changed mission at once: either `hold_first`
        puts it into Hold before, or `despite` names `flies_new_plan_at_once`.

        Raises:
            Refused: the vehicle refuses an item, or has different items afterwards; the text names the items.
        """
        return self._portal.call(
            lambda: self._inner.upload(
                plan,
                plan_id=plan_id,
                version=version,
                hold_first=hold_first,
                despite=despite,
                timeout_s=timeout_s,
            )
        )

    def download(self, *, timeout_s: float = TRANSFER_TIMEOUT_S) -> dict[str, Any]:
        """Reads the vehicle's items; returns the same result as `plan()`."""
        return self._portal.call(lambda: self._inner.download(timeout_s=timeout_s))

    def plan(self) -> dict[str, Any]:
        """The last downloaded or verified plan: `plan`, `read_unix_s`, `still_held` (by the vehicle)."""
        return self._portal.call(lambda: self._inner.plan())

    def compare(
        self, plan: Plan | None = None, *, plan_id: str | None = None, version: int | None = None
    ) -> dict[str, Any]:
        """Compares a plan with the last downloaded one: whether it is `equal`, and the `differences`."""
        return self._portal.call(lambda: self._inner.compare(plan, plan_id=plan_id, version=version))

    def clear(self) -> None:
        """Clears mission, geofence and rally points on the vehicle; refused while the vehicle is in Mission
        mode.
        """
        self._portal.call(lambda: self._inner.clear())

    def start(
        self,
        item: int | None = None,
        *,
        despite: Sequence[str] = (),
        dry_run: str | None = None,
        mission_id: int | None = None,
    ) -> None:
        """Starts the mission at an item (counted from 0) or at the current item; arms the vehicle if needed.

        `dry_run` is the id of a dry run of the plan on the vehicle; the server compares the two flights.
        To resume an interrupted flight, give `item` and `mission_id` of `state()["resume"]`.

        Raises:
            Refused: the plan is unknown or has errors, and `despite` does not list the codes; the dry run
                was made for another plan or position; or the vehicle has another mission than `mission_id`.
        """
        self._portal.call(
            lambda: self._inner.start(item, despite=despite, dry_run=dry_run, mission_id=mission_id)
        )

    def flown(self) -> dict[str, Any]:
        """The newest flight of a plan, compared with the plan: `samples`, `planned_legs`,
        `deviation_max_m`.
        """
        return self._portal.call(lambda: self._inner.flown())

    def resume(self) -> None:
        """Resumes the mission in flight at the current item; `vehicle.hold()` pauses a mission. After a
        landing, use `start`.
        """
        self._portal.call(lambda: self._inner.resume())


class SyncOffboard(SetpointCalls[Response]):
    """A running setpoint stream.

    Args:
        vehicle: the vehicle.
        started: the server's response to the start.
        validity: validity of each setpoint, and the action on expiry.
    """

    def __init__(self, inner: offboard.Offboard, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal
        self.started = self._inner.started

    def send(self, body: Body) -> Response:
        """Sends any setpoint body; returns the stream's state.

        Raises:
            Invalid: a value is invalid.
            Refused: the setpoint cannot be flown, or the stream has ended.
        """
        return self._portal.call(lambda: self._inner.send(body))

    def follow_path(self, points: PathPoints) -> None:
        """Flies a curve through timed points and returns at its end; the vehicle then keeps the position of
        the last point.

        Raises:
            Timeout: another setpoint, mode or client has interrupted the path.
        """
        self._portal.call(lambda: self._inner.follow_path(points))

    @contextmanager
    def live(self) -> Generator[SyncLiveOffboard]:
        """Opens a WebSocket for setpoints at up to 100 Hz; the stream continues after the block.

        Yields:
            An object with the same calls; each call returns once the server has responded.
        """
        with self._portal.wrap_async_context_manager(self._inner.live()) as found:
            yield SyncLiveOffboard(found, self._portal)

    def status(self) -> Response:
        """Achieved rate, age and remaining validity of the setpoint; limits, failsafe, available setpoint
        types.
        """
        return self._portal.call(lambda: self._inner.status())

    def stop(self) -> None:
        """Switches the vehicle to Hold and ends the stream; does nothing if the stream has ended already."""
        self._portal.call(lambda: self._inner.stop())


class SyncLiveOffboard(SetpointCalls[Response]):
    """Setpoints over a WebSocket."""

    def __init__(self, inner: offboard.LiveOffboard, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal

    def send(self, body: Body) -> Response:
        """Sends any setpoint body; returns the `applied` setpoint and what the limits changed (`limited`).

        Raises:
            Invalid, Refused: as with `Offboard.send`; the socket stays open.
            Unreachable: the server has closed the connection.
        """
        return self._portal.call(lambda: self._inner.send(body))


class SyncOffboardMission:
    """The offboard mission of a vehicle.

    The mission continues when the program ends. Its document defines the action when no client has control
    (`actions.control_lost`, default `hold`).
    """

    def __init__(self, inner: offboard_mission.OffboardMission, portal: BlockingPortal) -> None:
        self._inner = inner
        self._portal = portal

    def state(self) -> dict[str, Any] | None:
        """Status of the newest mission (as the topic `offboard_mission`); None if no mission was started."""
        return self._portal.call(lambda: self._inner.state())

    def flown(self) -> dict[str, Any]:
        """The flight of the newest mission: `samples` with flown and sent positions, `planned_legs`,
        `duration_s`, `planned_duration_s`, `deviation_mean_m`, …
        """
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
        """Starts a mission (a document, or one stored on the server). The vehicle arms and takes off if the
        mission has these steps.

        `dry_run` is the id of a dry run with several flights; the server reports when the vehicle leaves the
        corridor of these flights.

        Raises:
            Refused: the mission has errors that `despite` does not list, or a needed estimate is missing.
        """
        return self._portal.call(
            lambda: self._inner.start(
                mission, plan_id=plan_id, version=version, dry_run=dry_run, despite=despite
            )
        )

    def pause(self) -> dict[str, Any]:
        """Pauses the mission: the vehicle stops on its path."""
        return self._portal.call(lambda: self._inner.pause())

    def resume(self) -> dict[str, Any]:
        """Resumes the mission from the vehicle's current position."""
        return self._portal.call(lambda: self._inner.resume())

    def skip(self) -> dict[str, Any]:
        """Skips the current step."""
        return self._portal.call(lambda: self._inner.skip())

    def go_on(self) -> dict[str, Any]:
        """Continues after a step that waits for the operator."""
        return self._portal.call(lambda: self._inner.go_on())

    def abort(self, then: str = "hold") -> dict[str, Any]:
        """Ends the mission; `then` is hold, return or land."""
        return self._portal.call(lambda: self._inner.abort(then))
