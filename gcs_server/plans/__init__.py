"""Waypoint plans and offboard missions on the server: stored with versions, checked, imported, exported."""
