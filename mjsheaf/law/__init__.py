"""The decentralized sheaf law u_i = -k1 g_i^+ eta_i: stages over edges, and the door for laws in Python."""

from mjsheaf.law.law import ControlArrays, LawArrays, Memory, disagreement, edges_of, new_memory, pack_law

__all__ = ["ControlArrays", "LawArrays", "Memory", "disagreement", "edges_of", "new_memory", "pack_law"]
