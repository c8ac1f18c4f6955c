"""The decentralized sheaf law u_i = -k1 g_i^+ eta_i, as one agent runs it and as an ensemble."""

from mjsheaf.control.law import LawArrays, LocalLaw, disagreement, pack_law

__all__ = ["LawArrays", "LocalLaw", "disagreement", "pack_law"]
