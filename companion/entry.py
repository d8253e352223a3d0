"""The entry point of the command `companion`. It imports the command where Ctrl-C is handled."""


def main() -> int:
    """Runs the command; returns its status, 130 for Ctrl-C while it is imported."""
    try:
        from .cli import main as run_command

        return run_command()
    except KeyboardInterrupt:
        return 130
