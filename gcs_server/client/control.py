"""Who may command a vehicle, from a program: `async with vehicle.control.held(): …`.

A program need not care: its first command takes control that nobody holds, and the end of its `Gcs` block
releases it. Where another has control, commands raise `NotInControl`.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager, suppress
from typing import Any, Literal, Protocol

from gcs_server.client.errors import ApiError, Unreachable
from gcs_server.client.setpoints import Body

OnLost = Literal["nothing", "hold", "land", "rtl"]
RENEWALS_A_LEASE = 4
POLL_S = 0.25


class Requester(Protocol):
    """The part of a vehicle that is needed here."""

    async def request(self, method: str, path: str = "", body: Body | None = None) -> Any: ...


class Control:
    """A vehicle's `control`; each call answers how it then stands (`holder`, `yours`, `requests`, …)."""

    def __init__(self, vehicle: Requester) -> None:
        self._vehicle = vehicle

    async def show(self) -> dict[str, Any]:
        """Who has it, since when, who asks for it."""
        return await self._vehicle.request("GET", "/control")

    async def take(self, *, force: bool = False, on_expiry: OnLost | None = None) -> dict[str, Any]:
        """Takes control.

        Args:
            force: from another, who was asked and denied, did not answer, or cannot be asked.
            on_expiry: what the flying vehicle is told should this program not be heard for `lease_s`.

        Raises:
            NotInControl: another has it.
            Refused: forced without asking first.
        """
        body: Body = {"force": force}
        return await self._vehicle.request(
            "POST", "/control/take", body if on_expiry is None else {**body, "on_expiry": on_expiry}
        )

    async def request(self, reason: str | None = None, *, wait_s: float = 0.0) -> dict[str, Any]:
        """Asks the holder; with `wait_s` waits so long for the answer.

        Raises:
            NotInControl: denied, or not answered within `wait_s`.
        """
        status = await self._vehicle.request(
            "POST", "/control/request", {} if reason is None else {"reason": reason}
        )
        if wait_s <= 0:
            return status
        loop = asyncio.get_running_loop()
        end_s = loop.time() + wait_s
        while not status["yours"] and loop.time() < end_s:
            if all(asking["key"] != status["your_key"] for asking in status["requests"]):
                break  # denied
            await asyncio.sleep(POLL_S)
            status = await self.show()
        return status if status["yours"] else await self.take()

    async def grant(self, client: str) -> dict[str, Any]:
        """Hands control to one who asks, by key or name."""
        return await self._vehicle.request("POST", "/control/grant", {"client": client})

    async def deny(self, client: str, reason: str | None = None) -> dict[str, Any]:
        """Keeps control; the one who asks may then force it."""
        why: Body = {} if reason is None else {"reason": reason}
        return await self._vehicle.request("POST", "/control/deny", {"client": client, **why})

    async def release(self) -> dict[str, Any]:
        """Gives it up; nothing changes in flight."""
        return await self._vehicle.request("POST", "/control/release")

    @asynccontextmanager
    async def held(
        self, *, force: bool = False, on_expiry: OnLost | None = None
    ) -> AsyncGenerator[dict[str, Any]]:
        """Has control for the length of a block, renewed while the program runs, released at its end."""
        status = await self.take(force=force, on_expiry=on_expiry)
        trouble: BaseException | None = None
        async with asyncio.TaskGroup() as group:
            renewing = group.create_task(self._renew(status["lease_s"] / RENEWALS_A_LEASE))
            try:
                yield status
            except BaseException as error:
                trouble = error  # raised below: a group would wrap it
            renewing.cancel()
        with suppress(ApiError, Unreachable):
            await asyncio.shield(self.release())
        if trouble is not None:
            raise trouble

    async def _renew(self, period_s: float) -> None:
        while True:
            await asyncio.sleep(period_s)
            with suppress(ApiError, Unreachable):  # who lost it learns so by the next command
                await self._vehicle.request("POST", "/control/renew")
