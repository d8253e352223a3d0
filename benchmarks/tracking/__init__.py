"""Tracked obstacles against the model of each frame: stability, ids, movers, phantoms, missed rays, cost."""
