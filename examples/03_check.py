"""
Check a team before a run
=========================

``check`` decides the paper's assumptions before anything runs. Drones that see only boats are free along z;
the record says so and proposes a fix.
"""

import matplotlib.pyplot as plt

import mjsheaf

record = mjsheaf.check(mjsheaf.load_scenario("air_tracks_surface"))
for assumption in record["assumptions"]:
    print(f"{assumption['number']}  {assumption['verdict']:9}  {assumption['name']}")

# %%
cohomology = record["relative_cohomology"]
print("dim H^0(G, G_p; F) =", cohomology["dimension"])
for direction in cohomology["basis"]:
    print(direction["description"])
assert not record["ok"]

# %%
# A team that Theorem 1 covers has a bound on the error for all time.
theorem = mjsheaf.check(mjsheaf.load_scenario("certified"))["theorem"]
print("applies:", theorem["applies"], "  ultimate radius:", round(theorem["radius_U"], 3), "m")

# %%
# A higher gain makes the radius smaller.
gains = [1, 2, 4, 8]
radii = [
    mjsheaf.check(mjsheaf.load_scenario("certified", {"controller.gain": k}))["theorem"]["radius_U"] for k in gains
]
figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
axes.plot(gains, radii, "o-")
axes.set(xlabel="gain k1 (1/s)", ylabel="ultimate radius (m)")
