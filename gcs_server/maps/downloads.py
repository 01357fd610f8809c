"""Downloads from addresses that an operator chose, bounded in time, size and number of redirects."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncGenerator
from contextlib import asynccontextmanager
from typing import TYPE_CHECKING

from gcs_server.version import __version__

if TYPE_CHECKING:
    import httpx

TIMEOUT_S = 10.0
MAX_REDIRECTS = 3


class NoAnswer(Exception):
    """An address did not answer with what was asked for; the text is the reason, as a clause."""


class Downloads:
    """One client of HTTP, which is made when it is needed first."""

    def __init__(self) -> None:
        self._client: httpx.AsyncClient | None = None

    @asynccontextmanager
    async def answer(self, url: str, headers: dict[str, str] | None = None) -> AsyncGenerator[httpx.Response]:
        """The answer of an address, whose body has not been read. Raises NoAnswer."""
        import httpx  # only a server with a chosen source needs it

        if self._client is None:
            self._client = httpx.AsyncClient(
                timeout=TIMEOUT_S,
                follow_redirects=True,
                max_redirects=MAX_REDIRECTS,
                headers={"User-Agent": f"offboard-gcs/{__version__}"},
            )
        try:
            async with (
                asyncio.timeout(2 * TIMEOUT_S),
                self._client.stream("GET", url, headers=headers) as answer,
            ):
                yield answer
        except (httpx.HTTPError, httpx.InvalidURL) as error:
            raise NoAnswer(str(error) or type(error).__name__) from error
        except TimeoutError:
            raise NoAnswer(f"no answer in {2 * TIMEOUT_S:g} s") from None

    async def document(self, url: str, max_bytes: int) -> bytes:
        """A whole document. Raises NoAnswer."""
        async with self.answer(url) as answer:
            if answer.status_code != 200:
                raise NoAnswer(f"it answers with status {answer.status_code}")
            return await body(answer, max_bytes, f"its answer has more than {max_bytes / 1e6:g} MB")

    async def close(self) -> None:
        """Ends all requests."""
        if self._client is not None:
            await self._client.aclose()


async def body(answer: httpx.Response, max_bytes: int, too_large: str) -> bytes:
    """The body of an answer, unpacked. Raises NoAnswer with the text `too_large`."""
    content = bytearray()
    async for part in answer.aiter_bytes():
        content += part
        if len(content) > max_bytes:
            raise NoAnswer(too_large)
    return bytes(content)
