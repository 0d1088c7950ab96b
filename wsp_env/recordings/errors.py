"""What can be wrong with a campaign: the error that refuses it and the warning that says what was repaired."""

from wsp_env.parameters.quantity import readable


class CampaignError(ValueError):
    """A campaign that cannot be used; the message names file, column and line, and says how to repair it."""

    def __init__(self, message: object = "") -> None:
        super().__init__(readable(str(message)))


class ContradictionError(CampaignError):
    """A channel that cannot be what it is said to be: in another unit, or of the wrong sign.

    Parameters
    ----------
    where : the file
    channel : as `channels.CHANNELS` names it; "axle*_..." for that of every axle
    suspicion : what goes on from the channel's name, a statement or a question
    remedy : what to do, in lower case
    factor : recorded over true [-]

    """

    def __init__(self, where: str, channel: str, suspicion: str, remedy: str, factor: float) -> None:
        end = f" {remedy[0].upper()}{remedy[1:]}" if suspicion.endswith("?") else f"; {remedy}"
        super().__init__(f"{where}: {channel} {suspicion}{end}")
        self.where, self.channel, self.suspicion, self.remedy, self.factor = where, channel, suspicion, remedy, factor

    def __reduce__(self) -> tuple[type["ContradictionError"], tuple[str, str, str, str, float]]:
        """Return how it is made again in another process."""
        return type(self), (self.where, self.channel, self.suspicion, self.remedy, self.factor)


class CampaignWarning(UserWarning):
    """Something in a recording was repaired or looks wrong; the message says what and where."""

    def __init__(self, message: object = "") -> None:
        super().__init__(readable(str(message)))


def first_line(error: Exception) -> str:
    """Return the first line of what another library says is wrong."""
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
