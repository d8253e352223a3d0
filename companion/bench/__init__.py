"""`companion bench`: measures the speed of the extraction on this computer."""
