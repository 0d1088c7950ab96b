"""What can be wrong with a bank or its labels."""


class BankError(ValueError):
    """A bank that cannot be made or scored; the message says how to repair it."""
