"""`python -m gcs_server.api.schema`: prints the OpenAPI description without starting anything."""

from __future__ import annotations

import asyncio
import functools
import json
import sys
from importlib import import_module
from pkgutil import iter_modules
from typing import Any

from fastapi import Depends, FastAPI, Response
from starlette.routing import BaseRoute

from gcs_server import api
from gcs_server.api import problems, reference_page
from gcs_server.api.authorized import enter
from gcs_server.api.described import describe_plans, describe_refusals, flatten_unions, rename_schemas
from gcs_server.api.permission import check_permission
from gcs_server.api.setpoints import SCHEMA_NAMES
from gcs_server.control.commands import API, BY_CALL
from gcs_server.version import __version__

FIRST = ("offboard_routes", "offboard_stream")
"""FastAPI compares a request with all routes in their order, so the setpoints, which are the most frequent
requests, come first."""
FOUND = sorted(module.name for module in iter_modules(api.__path__) if module.name.endswith("_routes"))
PARTS = [import_module(f"{api.__name__}.{name}") for name in dict.fromkeys((*FIRST, *FOUND))]
"""The modules with the routes under /api/v1: each file `*_routes.py`."""
TAGS = (
    "station",
    "vehicles",
    "commands",
    "control",
    "offboard",
    "groups",
    "gimbal",
    "camera",
    "parameters",
    "logs",
    "flights",
    "recordings",
    "operations",
    "plans",
    "dry runs",
    "mission",
    "offboard mission",
)
"""Order of the sections of the API reference."""


class _DocumentedApp(FastAPI):
    """Adds the required permission to each operation, and the errors of access control and limits."""

    def openapi(self) -> dict[str, Any]:
        if self.openapi_schema is None:
            openapi = super().openapi()
            openapi["components"]["securitySchemes"] = {
                "token": {
                    "type": "http",
                    "scheme": "bearer",
                    "description": "The token in the link that the server prints at its start (`GCS_TOKEN`).",
                }
            }
            openapi["security"] = [{"token": []}, {}]  # on loopback a token is required only if one was set
            for path, operations in openapi["paths"].items():
                for method, operation in operations.items():
                    operation["x-authority"] = BY_CALL[f"{method.upper()} {path}"].openapi_fields()
            describe_refusals(openapi)
            rename_schemas(openapi, SCHEMA_NAMES)
            flatten_unions(openapi)
            describe_plans(openapi)
        assert self.openapi_schema is not None
        return self.openapi_schema


PERMISSION_CHECK = [Depends(check_permission)]
"""Checks the permission before the routes that are not below /api/v1."""


@functools.cache
def api_routes(*, described: bool = False) -> tuple[BaseRoute, ...]:
    """The routes, created once for all applications, because this takes half a second.
    `dependency_overrides` of an application have no effect on them.
    """
    # Directly in the application, because each nested router costs time per request.
    entered = [Depends(enter)]
    routes = [route for part in PARTS for route in part.router.build(API, entered, described=described)]
    return (*routes, *reference_page.router.build("", PERMISSION_CHECK, described=described))


def bare_app(*, described: bool = False) -> FastAPI:
    """An application with the routes, but without a running server.

    Args:
        described: whether the routes have the models of their answers, for `openapi`.
    """
    app = _DocumentedApp(
        dependencies=PERMISSION_CHECK,
        title="Offboard GCS",
        version=__version__,
        description=(
            "A ground-control station for PX4. Field names contain quantity, frame and unit; errors are "
            "problem+json. "
            "A command succeeds once the state that the vehicle reports shows its result. "
            "Name your program in `X-Client` and give it a unique id in `X-Client-Id`: only one client at a "
            "time controls a vehicle (409 `not_in_control`). "
            "A server that other machines can reach requires its token with every call, as "
            "`Authorization: Bearer …`; without the token the response is 401."
        ),
        separate_input_output_schemas=False,  # requests and responses use the same type for a plan
        openapi_tags=[{"name": tag} for tag in TAGS],
        openapi_url=None,  # FastAPI would encode it again for each request
        docs_url=None,
        redoc_url=None,
    )
    problems.install(app)
    app.router.routes.extend(api_routes(described=described))

    @app.get(f"{API}/openapi.json", include_in_schema=False)
    async def openapi() -> Response:
        # The first call takes almost a second, so it must not run in the event loop.
        return Response(await asyncio.to_thread(_description_json), media_type="application/json")

    return app


@functools.cache
def description() -> dict[str, Any]:
    """The OpenAPI description, which is the same for all applications of this process."""
    return bare_app(described=True).openapi()


@functools.cache
def _description_json() -> bytes:
    return json.dumps(description(), separators=(",", ":")).encode()


def main() -> None:
    """Prints the description as JSON."""
    json.dump(description(), sys.stdout, indent=1)
    sys.stdout.write("\n")


if __name__ == "__main__":
    main()
