"""The MAVLink link: transport, session, clock synchronisation, signing, telemetry logs."""
