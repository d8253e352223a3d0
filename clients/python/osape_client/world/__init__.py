"""The merged world: a copy kept up to date from the service's messages, and queries of it."""
