"""The event loop's side of a stream: control, configuration, status, and the operator's stored limits."""
