"""The decentralized sheaf law u_i = -k1 g_i^+ eta_i: stages over edges, and the door for laws in Python."""
