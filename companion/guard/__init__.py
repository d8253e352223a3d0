"""The guard: asks the autopilot to slow down or stop where its braking distance does not fit into the space seen free."""
