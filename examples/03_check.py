"""
Check a team before a run
=========================

``check`` decides the paper's assumptions, and then tries the mission once on bodies. Drones that see only boats are
free along z; the record says so and proposes a fix, which it tries too.
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
problem = record["problems"][0]
print("fix:", problem["fix"], "  tracking error with it:", round(problem["tried"]["tracking_error"], 3), "m")

# %%
# A team that Theorem 1 covers has a bound on the error for all time. It needs no trial.
theorem = mjsheaf.check(mjsheaf.load_scenario("certified"), trial=False)["theorem"]
print("applies:", theorem["applies"], "  ultimate radius:", round(theorem["radius_U"], 3), "m")

# %%
# A higher gain makes the radius smaller.
gains = [1, 2, 4, 8]
radii = [
    mjsheaf.check(mjsheaf.load_scenario("certified", {"controller.gain": k}), trial=False)["theorem"]["radius_U"]
    for k in gains
]
figure, axes = plt.subplots(figsize=(5, 3), layout="constrained")
axes.plot(gains, radii, "o-")
axes.set(xlabel="gain k1 (1/s)", ylabel="ultimate radius (m)")
