"""A router that only notes its routes, and builds them once, for an application.

FastAPI builds each route where it is declared and again where it is included, and for both the models of all
its answers. Answers never pass through these models (`responses.py`), so only the API's description has
them. This takes a second off the server's start.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from fastapi import APIRouter, params
from starlette.routing import BaseRoute


class Routes(APIRouter):
    """The routes of one module; every function returns a `Response`."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._noted: list[tuple[str, Callable[..., Any], dict[str, Any]]] = []
        self._sockets: list[tuple[str, Callable[..., Any]]] = []

    def add_api_route(self, path: str, endpoint: Callable[..., Any], **options: Any) -> None:
        """Notes a route; called by the decorators."""
        self._noted.append((path, endpoint, options))

    def add_api_websocket_route(self, path: str, endpoint: Callable[..., Any], *_: Any, **__: Any) -> None:
        """Notes a WebSocket; called by the decorator."""
        self._sockets.append((path, endpoint))

    def build(
        self, prefix: str, dependencies: Sequence[params.Depends], *, described: bool
    ) -> list[BaseRoute]:
        """The routes, with the models of their answers only if they are to be `described`."""
        router = APIRouter(
            prefix=f"{prefix}{self.prefix}",
            tags=self.tags,
            dependencies=dependencies,
            responses=self.responses if described else {},
            route_class=self.route_class,
            include_in_schema=self.include_in_schema,
        )
        for path, endpoint, options in self._noted:
            answers: dict[str, Any] = {} if described else {"response_model": None, "responses": None}
            router.add_api_route(path, endpoint, **options | answers)
        for path, endpoint in self._sockets:
            router.add_api_websocket_route(path, endpoint)
        return router.routes
