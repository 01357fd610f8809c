"""The HTTP and WebSocket server: limits size, time, number and memory of all connections."""
