"""Waypoint plans on the server: kept with versions, checked, imported, exported."""
