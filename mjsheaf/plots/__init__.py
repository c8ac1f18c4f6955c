"""Pictures of a run: errors over time, all trajectories, initial against final configuration."""

from mjsheaf.plots.figures import plot_configurations, plot_errors, plot_trajectories
from mjsheaf.plots.palette import group_of_vehicles, palette

__all__ = ["group_of_vehicles", "palette", "plot_configurations", "plot_errors", "plot_trajectories"]
