"""The message schema (osape_v1.proto) and the Python code generated from it by `make proto`."""
