"""Cellular sheaves on graphs: stalks, restriction maps, cohomology and harmonic extension.

This layer is linear algebra alone, without agents, time or bodies.
"""

from mjsheaf.sheaf.nonlinear import NonlinearSheaf
from mjsheaf.sheaf.sections import RANK_TOLERANCE
from mjsheaf.sheaf.sheaf import DirichletProblem, HarmonicExtension, Sheaf

__all__ = ["RANK_TOLERANCE", "DirichletProblem", "HarmonicExtension", "NonlinearSheaf", "Sheaf"]
