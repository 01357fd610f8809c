"""HTTP and WebSockets on the wire: every connection bounded in size, time, number and memory."""
