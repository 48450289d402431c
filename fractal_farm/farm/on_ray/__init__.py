"""Ray: the only folder that imports it. `session` starts or joins a cluster, `executor` works on it."""
