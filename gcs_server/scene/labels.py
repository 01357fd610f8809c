"""Labels in the page's font and colours.

viser's own labels are black on white in every theme, and its HTML panels in the scene do not work in version
1.1. Therefore a label is an empty node, and its text is sent in an HTML element of viser's hidden panel. The
script of `page.py` draws the texts at the nodes.
"""

from __future__ import annotations

import html
from typing import Literal

import viser

from gcs_server.scene.moving_node import MovingNode
from gcs_server.scene.texts import in_language
from missions.frames import Vector3

Side = Literal["above", "below", "sign"]

UPDATE_PERIOD_S = 0.2
"""Minimum time between two updates [s]; numbers that change faster cannot be read."""


def origin_text(origin_deg_m: Vector3 | None) -> str:
    """`lat_deg,lon_deg,alt_amsl_m` to a millimetre; empty if the position is not known."""
    if origin_deg_m is None:
        return ""
    lat_deg, lon_deg, alt_amsl_m = origin_deg_m
    return f"{lat_deg:.9f},{lon_deg:.9f},{alt_amsl_m:.3f}"


class Label:
    """A label at a point of the scene.

    Args:
        side: where the text is: above or below the point, or (`sign`) at the point and without a frame.
    """

    def __init__(self, client: viser.ClientHandle, name: str, colour: str, *, side: Side = "above") -> None:
        client.scene.add_frame(name, show_axes=False)
        self._node = MovingNode(client, name)
        self.name = name
        self._side = side
        self.colour = colour
        self.text = ""
        self.note = ""
        self.visible = True

    def move(self, position_m: Vector3) -> None:
        """Moves the label."""
        self._node.place(position_m)

    def html(self, language: str) -> str:
        """HTML in a language for the script that draws the label; empty if there is nothing to show."""
        if not self.visible or not self.text:
            return ""
        return (
            f'<i data-gcs-tag="{html.escape(self.name)}" data-gcs-colour="{self.colour}" '
            f'data-gcs-side="{self._side}" data-gcs-note="{html.escape(in_language(self.note, language))}">'
            f"{html.escape(in_language(self.text, language))}</i>"
        )


class LabelLayer:
    """The HTML element with all labels of one browser, in its language."""

    def __init__(self, client: viser.ClientHandle, language: str) -> None:
        self._language = language
        self._html = client.gui.add_html("")
        self._sent_text = ""
        self._next_s = 0.0

    def is_due(self, now_s: float) -> bool:
        """Whether `update` is due: at most five times a second."""
        if now_s < self._next_s:
            return False
        self._next_s = now_s + UPDATE_PERIOD_S
        return True

    def update(self, labels: list[Label], *, mode: str, scale: str, origin: str) -> None:
        """Sends the texts if a text has changed.

        Args:
            mode: mode of the view; `gimbal` has a mark at the centre.
            scale: text with the size of the grid's cells.
            origin: geographic position of the world's origin, for layers that the page draws over the view;
                empty while it is not known.
        """
        attributes = f'data-gcs-mode="{html.escape(mode)}" data-gcs-origin="{html.escape(origin)}"'
        view = f"<i {attributes}>{html.escape(in_language(scale, self._language))}</i>"
        text = view + "".join(label.html(self._language) for label in labels)
        if text != self._sent_text:
            self._sent_text = text
            self._html.content = text

    def remove(self) -> None:
        """Removes all labels."""
        self._html.remove()
