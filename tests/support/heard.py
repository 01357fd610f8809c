"""What a link hands on, kept for a test to look at."""

import asyncio


class Heard:
    """Starts a link and keeps its bytes, its peers and its states, in order."""

    def __init__(self, link):
        self.link, self.data, self.peers, self.gone, self.states = link, [], [], [], []

    def start(self):
        self.link.start(self._bytes, lambda p: self.gone.append(p.name), self._state)
        return self

    def _bytes(self, data, peer, _received_s):
        self.data.append(data)
        self.peers.append(peer)

    def _state(self):
        self.states.append(self.link.info().state)

    async def until(self, good, patience_s=20.0):
        """Looks until that holds.

        Raises:
            TimeoutError: it never did.
        """
        async with asyncio.timeout(patience_s):
            while not good():  # noqa: ASYNC110 a test watches from outside
                await asyncio.sleep(0.005)


def run(story):
    """A coroutine function, on a loop of its own and in real time."""
    asyncio.run(story())
