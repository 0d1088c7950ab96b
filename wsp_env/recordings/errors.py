"""What can be wrong with a campaign: the error that refuses it and the warning that says what was repaired."""

from wsp_env.parameters.quantity import readable


class CampaignError(ValueError):
    """A campaign that cannot be used; the message names file, column and line, and says how to repair it."""

    def __init__(self, message: object = "") -> None:
        super().__init__(readable(str(message)))


class CampaignWarning(UserWarning):
    """Something in a recording was repaired or looks wrong; the message says what and where."""

    def __init__(self, message: object = "") -> None:
        super().__init__(readable(str(message)))


def first_line(error: Exception) -> str:
    """Return the first line of what another library says is wrong."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
