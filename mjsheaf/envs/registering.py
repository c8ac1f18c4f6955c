"""Names of shipped scenarios in Gymnasium."""


def register_scenarios() -> None:
    """Register every shipped scenario as `mjsheaf/NAME-v0`; nothing is loaded until one is made."""
    from gymnasium.envs.registration import register, registry

    from mjsheaf.scenario.load import list_scenarios

    for name in list_scenarios():
        if f"mjsheaf/{name}-v0" not in registry:
            register(f"mjsheaf/{name}-v0", entry_point="mjsheaf.envs.gym:make_named", kwargs={"name": name})
