"""The medium that carries vehicles: flow fields and disturbances, with their bounds."""

from mjsheaf.media.flow import FlowField
from mjsheaf.media.varying import Disturbance

__all__ = ["Disturbance", "FlowField"]
