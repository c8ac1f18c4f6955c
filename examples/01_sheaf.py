"""
The sheaf algebra alone
=======================

A boat in the plane and two drones in space compare horizontal positions. Nothing here needs MuJoCo or a
scenario.
"""

import matplotlib.pyplot as plt
import numpy as np

from mjsheaf import Sheaf

P = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # R^3 to R^2
s = Sheaf({"boat": 2, "drone 1": 3, "drone 2": 3})
s.add_edge("boat", "drone 1", np.eye(2), P)
s.add_edge("drone 1", "drone 2", np.eye(3), np.eye(3))

print("dimensions of H^0 and H^1:", s.betti())

# %%
# Hold the boat at (4, 2). Both drones hover above it. Nothing determines their height, so the extension is not unique.
h = s.harmonic_extension({"boat": [4.0, 2.0]})
print("unique:", h.unique, "  free directions:", h.null_basis.shape[1])
print({name: x.round(3).tolist() for name, x in h.x.items()})

# %%
# An altimeter on one drone determines the height of both. It is an edge to a vertex with a known value.
t = Sheaf({"boat": 2, "drone 1": 3, "drone 2": 3, "height": 1})
t.add_edge("boat", "drone 1", np.eye(2), P)
t.add_edge("drone 1", "drone 2", np.eye(3), np.eye(3))
t.add_edge("drone 2", "height", [[0.0, 0.0, 1.0]], [[1.0]])
h = t.harmonic_extension({"boat": [4.0, 2.0], "height": [10.0]})
assert h.unique
print({name: x.round(3).tolist() for name, x in h.x.items()})

# %%
# The sheaf Laplacian of the first sheaf: a block for each pair of vertices that share an edge.
figure, axes = plt.subplots(figsize=(4, 3), layout="constrained")
image = axes.matshow(s.laplacian().toarray(), cmap="RdBu", vmin=-2, vmax=2)
figure.colorbar(image)
