"""Plans of both kinds on the server: stored with versions, checked, imported, exported."""
