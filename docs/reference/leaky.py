"""A term that users register: see Extending mjsheaf."""

import mjsheaf


@mjsheaf.register(parameters=["gain", "forgetting"], memory=3)
def leaky_integral(residual, command, memory, parameters, period):
    """Command against the disagreement of the last while, which is forgotten at a rate in 1/s."""
    for i in range(3):
        command[i] -= parameters[0] * memory[i]
        memory[i] += period * (residual[i] - parameters[1] * memory[i])
