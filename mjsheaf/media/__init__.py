"""The medium that carries vehicles: flow fields and disturbances, with their bounds."""
