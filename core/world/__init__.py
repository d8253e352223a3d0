"""The merged world: the models of many frames in one map.

Names of parameters that mean the same in all modules: tables: Tables of the planes, i, k: their slots; free: FreeTables;
observations: (N,) OBSERVATION of a frame, seen: one of them; view: FreeView of the frame; settings: (1,) WORLD_RULES, rules:
its record; a, b, box: Box; t_ns: exposure."""
