"""A run that is changed while it proceeds: a user's changes become events of its scenario.

Modules:

- actions: changes that a user may make, as events of the scenario.

The session continues under the scenario with this event, so the recorded scenario reproduces the session, to the bit.
"""
