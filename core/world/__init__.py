"""The merged world: the models of many frames in one map."""
