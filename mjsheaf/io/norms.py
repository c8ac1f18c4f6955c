"""The two norms of a team's errors, m.

    per_agent_rms   root mean square over the agents, sqrt(|e|^2 / N): headlines, and errors of runs
    team_norm       |e|, the norm over the whole team: bounds of certificates

A bound R on |e| bounds the RMS over N agents by R / sqrt(N).
"""

import math
from typing import Literal

Norm = Literal["per_agent_rms", "team_norm"]

PER_AGENT_RMS: Literal["per_agent_rms"] = "per_agent_rms"
TEAM_NORM: Literal["team_norm"] = "team_norm"

OF_TEAM = "which norm the errors of this record are, but for fields `..._per_agent`, which are the RMS over agents"
"""Description of the field `norm` of a record of certificates."""

OF_NONE = "none of the errors is a norm over the whole team: the tracking error is the RMS over agents"
"""Description of the field `norm` of a record of measured errors."""


def per_agent(size: float | None, agents: int) -> float | None:
    """Return the RMS over agents of errors whose norm over the whole team is given, m; None stays None."""
    return None if size is None else size / math.sqrt(agents)
