"""One parameter at a time, verified."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Param:
    """A parameter as the vehicle reports it."""

    name: str
    value: int | float
    is_integer: bool


class ParamService:
    """PX4's bytewise parameters."""

    async def get(self, name: str) -> Param:
        """Reads one.

        Raises:
            NoReply: PX4 is silent about unknown names, too.
        """
        raise NotImplementedError

    async def set(self, name: str, value: float) -> Param:
        """Writes one and returns what the vehicle then reports.

        Raises:
            Rejected: the vehicle reports another value than was set.
        """
        raise NotImplementedError
