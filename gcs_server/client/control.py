"""Control of a vehicle by a program: `async with vehicle.control.held(): …`.

Most programs do not need these calls: the first command takes control if no client has it, and the end of the
`Gcs` block releases it. While another client has control, commands raise `NotInControl`.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager, suppress
from typing import Any, Literal, Protocol

from gcs_server.client.errors import ApiError, Unreachable
from gcs_server.client.setpoints import Body

OnControlLost = Literal["nothing", "hold", "land", "rtl"]
RENEWALS_PER_LEASE = 4
POLL_S = 0.25


class VehicleApi(Protocol):
    """The part of a vehicle that this module uses."""

    async def request(self, method: str, path: str = "", body: Body | None = None) -> Any: ...


class Control:
    """A vehicle's `control`; each call returns the state of control (`holder`, `yours`, `requests`, …)."""

    def __init__(self, vehicle: VehicleApi) -> None:
        self._vehicle = vehicle

    async def show(self) -> dict[str, Any]:
        """The client in control, since when, and the requests."""
        return await self._vehicle.request("GET", "/control")

    async def take(self, *, force: bool = False, on_expiry: OnControlLost | None = None) -> dict[str, Any]:
        """Takes control.

        Args:
            force: take control from another client that denied the request, did not answer it, or cannot
                receive requests.
            on_expiry: command sent to the flying vehicle if this program sends nothing for `lease_s`.

        Raises:
            NotInControl: another client has control.
            Refused: `force` was used without an earlier request.
        """
        body: Body = {"force": force}
        return await self._vehicle.request(
            "POST", "/control/take", body if on_expiry is None else {**body, "on_expiry": on_expiry}
        )

    async def request(self, reason: str | None = None, *, wait_s: float = 0.0) -> dict[str, Any]:
        """Requests control from the client that has it, and waits up to `wait_s` for the answer.

        Raises:
            NotInControl: the request was denied, or not answered within `wait_s`.
        """
        status = await self._vehicle.request(
            "POST", "/control/request", {} if reason is None else {"reason": reason}
        )
        if wait_s <= 0:
            return status
        loop = asyncio.get_running_loop()
        end_s = loop.time() + wait_s
        while not status["yours"] and loop.time() < end_s:
            if all(request["key"] != status["your_key"] for request in status["requests"]):
                break  # denied
            await asyncio.sleep(POLL_S)
            status = await self.show()
        return status if status["yours"] else await self.take()

    async def grant(self, client: str) -> dict[str, Any]:
        """Gives control to a client that requested it, by key or name."""
        return await self._vehicle.request("POST", "/control/grant", {"client": client})

    async def deny(self, client: str, reason: str | None = None) -> dict[str, Any]:
        """Denies a request; the denied client may then take control by force."""
        body: Body = {} if reason is None else {"reason": reason}
        return await self._vehicle.request("POST", "/control/deny", {"client": client, **body})

    async def release(self) -> dict[str, Any]:
        """Releases control; the flight does not change."""
        return await self._vehicle.request("POST", "/control/release")

    @asynccontextmanager
    async def held(
        self, *, force: bool = False, on_expiry: OnControlLost | None = None
    ) -> AsyncGenerator[dict[str, Any]]:
        """Keeps control inside a block: control is renewed while the program runs and released at the end."""
        status = await self.take(force=force, on_expiry=on_expiry)
        block_error: BaseException | None = None
        async with asyncio.TaskGroup() as group:
            renewal = group.create_task(self._renew(status["lease_s"] / RENEWALS_PER_LEASE))
            try:
                yield status
            except BaseException as error:
                block_error = error  # raised below, because a TaskGroup would wrap it
            renewal.cancel()
        with suppress(ApiError, Unreachable):
            await asyncio.shield(self.release())
        if block_error is not None:
            raise block_error

    async def _renew(self, period_s: float) -> None:
        while True:
            await asyncio.sleep(period_s)
            with suppress(ApiError, Unreachable):  # if control was lost, the next command raises the error
                await self._vehicle.request("POST", "/control/renew")
