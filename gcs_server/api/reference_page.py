"""The API reference at /docs: a page of this server that displays openapi.json. FastAPI's own page loads its
script from the internet, which a ground station in the field may not have.
"""

from __future__ import annotations

from pathlib import Path

from fastapi.responses import FileResponse, RedirectResponse

from gcs_server.api.routes import Routes

FOLDER = Path(__file__).resolve().parent / "reference"
_REVALIDATE = {"Cache-Control": "no-cache"}

router = Routes(include_in_schema=False)


@router.get("/docs")
async def page() -> FileResponse:
    """The HTML document of the page."""
    return FileResponse(FOLDER / "index.html", headers=_REVALIDATE)


@router.get("/docs/reference.js")
async def script() -> FileResponse:
    """The script of the page."""
    return FileResponse(FOLDER / "reference.js", media_type="text/javascript", headers=_REVALIDATE)


@router.get("/docs/reference.css")
async def style() -> FileResponse:
    """The style sheet of the page."""
    return FileResponse(FOLDER / "reference.css", headers=_REVALIDATE)


@router.get("/docs/")
@router.get("/api/v1/docs")
async def redirect() -> RedirectResponse:
    """Redirects other common addresses of an API reference to `/docs`."""
    return RedirectResponse("/docs", status_code=308)
