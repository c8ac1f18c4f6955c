"""The medium that carries vehicles: flow fields and disturbances, with their bounds."""

from mjsheaf.media.disturbance import Disturbance
from mjsheaf.media.flow import FlowField

__all__ = ["Disturbance", "FlowField"]
