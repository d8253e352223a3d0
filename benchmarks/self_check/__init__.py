"""How well the checks of the set-up do on rendered flights."""
