"""The 3D view: the only package that uses viser and ENU. `process.py` is the server's side of it."""
