"""Studies: many runs of one scenario, on every core or a cluster, that resume after an interruption."""
