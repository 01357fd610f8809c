"""Descriptions of WMTS services, as services write them."""

from __future__ import annotations

from collections.abc import Callable, Sequence

NAMESPACES = (
    'xmlns="http://www.opengis.net/wmts/1.0" xmlns:ows="http://www.opengis.net/ows/1.1" '
    'xmlns:xlink="http://www.w3.org/1999/xlink" version="1.0.0"'
)
SCALE_OF_ZOOM_0 = 559082264.0287178


def matrix_set(
    name: str = "google",
    *,
    zooms: Sequence[int] = range(20),
    named: Callable[[int], str] = str,
    crs: str = "urn:ogc:def:crs:EPSG::3857",
    corner: str = "-20037508.3428 20037508.3428",
    tile_px: int = 256,
) -> str:
    """A tile matrix set."""
    matrices = "".join(
        f"<TileMatrix><ows:Identifier>{named(zoom)}</ows:Identifier>"
        f"<ScaleDenominator>{SCALE_OF_ZOOM_0 / 2**zoom * 256 / tile_px}</ScaleDenominator>"
        f"<TopLeftCorner>{corner}</TopLeftCorner><TileWidth>{tile_px}</TileWidth>"
        f"<TileHeight>{tile_px}</TileHeight><MatrixWidth>{2**zoom}</MatrixWidth>"
        f"<MatrixHeight>{2**zoom}</MatrixHeight></TileMatrix>"
        for zoom in zooms
    )
    head = f"<ows:Identifier>{name}</ows:Identifier><ows:SupportedCRS>{crs}</ows:SupportedCRS>"
    return f"<TileMatrixSet>{head}{matrices}</TileMatrixSet>"


def layer(
    name: str = "aerial",
    *,
    title: str = "Aerial images",
    sets: Sequence[str] = ("google",),
    image: str = "image/png",
    template: str | None = None,
    more: str = "",
    limits: Sequence[str] = (),
) -> str:
    """A layer; with a template of addresses, or by parameters."""
    limited = "".join(
        f"<TileMatrixLimits><TileMatrix>{each}</TileMatrix></TileMatrixLimits>" for each in limits
    )
    limited = f"<TileMatrixSetLimits>{limited}</TileMatrixSetLimits>" if limits else ""
    links = "".join(
        f"<TileMatrixSetLink><TileMatrixSet>{each}</TileMatrixSet>{limited}</TileMatrixSetLink>"
        for each in sets
    )
    resource = "" if template is None else (
        f'<ResourceURL format="{image}" resourceType="tile" template="{template}"/>'
    )  # fmt: skip
    style = '<Style isDefault="true"><ows:Identifier>default</ows:Identifier></Style>'
    return (
        f"<Layer><ows:Title>{title}</ows:Title><ows:Identifier>{name}</ows:Identifier>{style}"
        f"<Format>{image}</Format>{more}{links}{resource}</Layer>"
    )


def description(*contents: str, kvp: str | None = None, provider: str = "Office of Maps") -> bytes:
    """The capabilities of a service.

    Args:
        contents: layers and tile matrix sets.
        kvp: address of GetTile with parameters; None: the service has none.
        provider: name of who provides it.
    """
    by_parameters = "" if kvp is None else (
        '<ows:OperationsMetadata><ows:Operation name="GetTile"><ows:DCP><ows:HTTP>'
        f'<ows:Get xlink:href="{kvp}"><ows:Constraint name="GetEncoding"><ows:AllowedValues>'
        "<ows:Value>KVP</ows:Value></ows:AllowedValues></ows:Constraint></ows:Get>"
        "</ows:HTTP></ows:DCP></ows:Operation></ows:OperationsMetadata>"
    )  # fmt: skip
    who = f"<ows:ServiceProvider><ows:ProviderName>{provider}</ows:ProviderName></ows:ServiceProvider>"
    inside = f"{who}{by_parameters}<Contents>{''.join(contents)}</Contents>"
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><Capabilities {NAMESPACES}>{inside}</Capabilities>'.encode()
    )
