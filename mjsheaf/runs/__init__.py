"""One run: simulating it, and the directory it leaves.

Where to look: simulate, many (`simulate_many`), publish (the directory, whole or not at all), figures (its plots),
expecting (`expect:` blocks).
"""
