"""The process that runs the stream scheduler, and the server's side of it."""
