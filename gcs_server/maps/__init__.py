"""Map tiles from the internet or a server in the field: chosen sources, kept tiles and saved regions."""
