"""Transports between vehicles. They carry packets as bytes, whatever their content."""
