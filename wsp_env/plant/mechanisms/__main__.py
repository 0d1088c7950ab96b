"""Prints the table of all mechanisms, including other packages', in Markdown: `python -m wsp_env.plant.mechanisms`."""

from wsp_env.plant.card import BALANCES, Card, Parameter
from wsp_env.plant.mechanisms import ALL

_HEAD = ("mechanism", "what it does", "acts in", "parameters: unit, typical, null; source", "shows in", "as", "next test")


def table() -> str:
    """Return the table, with one row for each mechanism."""
    rows = [_HEAD, tuple(":--" for _ in _HEAD), *map(_row, ALL.values())]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows)


def _row(card: Card) -> tuple[str, ...]:
    signature = card.signature
    parameters = "<br>".join(map(_parameter, card.parameters if card.named else _first_of_a_kind(card)))
    shows = ", ".join(balance for balance in BALANCES if balance in signature.balances)
    slots = ", ".join(f"`{slot}`" for slot in card.acts)
    return f"`{card.name}`", card.summary, slots, parameters, shows, signature.trace, signature.next_test


def _first_of_a_kind(card: Card) -> list[Parameter]:
    """Return one parameter for each group whose names differ only in the final number; the number is replaced by n."""
    kinds = {one.name.rstrip("0123456789"): one for one in reversed(card.parameters)}
    return [one if one.name == kind else one._replace(name=f"{kind}n") for kind, one in reversed(kinds.items())]


def _parameter(one: Parameter) -> str:
    unit = "" if one.unit == "-" else f" {one.unit}"
    null = f", null {one.null:g}{unit}" if one.kind == "size" else ""
    return f"`{one.name}`: {one.typical:g}{unit}{null}; {one.source}"


if __name__ == "__main__":
    print(table())
