"""Transports between vehicles. They carry packets as bytes and know nothing of their content."""
