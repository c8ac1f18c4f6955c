"""Scenario files: what may stand in one, reading it with clear errors, and building the system it describes."""

from mjsheaf.scenario.load import list_scenarios, load_scenario, read_scenario, scenario_from_mapping
from mjsheaf.scenario.scenario import Scenario

__all__ = ["Scenario", "list_scenarios", "load_scenario", "read_scenario", "scenario_from_mapping"]
