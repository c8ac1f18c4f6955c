"""What can go wrong, one class for each exit code of the command line."""


class MjsheafError(Exception):
    """Base of every error that mjsheaf raises on purpose.

    Attributes:
        exit_code: what the command line exits with.
    """

    exit_code = 1


class InputError(MjsheafError, ValueError):
    """The input is wrong; the message names the place and what is expected."""

    exit_code = 2


class SheafError(InputError):
    """A sheaf was given a vertex, map, offset or weight that does not fit it."""


class ScenarioError(InputError):
    """A scenario file, or an override of it, is not valid."""


class NotUniqueError(MjsheafError):
    """The harmonic extension is not unique: some agents are free to drift (Assumption 6 fails)."""

    exit_code = 1


class UnstableError(MjsheafError):
    """A simulation blew up; the message names the vehicle, the time and the likely cause."""

    exit_code = 3
