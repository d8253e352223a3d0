"""ZeroMQ streams: publishers, keys, receive times and world messages."""
