"""The wire and log schema (osape_v1.proto) and the Python code generated from it; `make proto` writes it anew."""
