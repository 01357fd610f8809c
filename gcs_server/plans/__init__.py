"""Plans of both kinds on the server: kept with versions, checked, imported, exported."""
