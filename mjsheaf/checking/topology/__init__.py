"""The team's sheaf alone: relative cohomology, what a loss breaks, and the repairs that fix it."""
