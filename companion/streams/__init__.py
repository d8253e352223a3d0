"""ZeroMQ streams: publishers, keys, receive times and the fast message encoder."""
