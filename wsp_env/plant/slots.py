"""Where mechanisms act. Each slot is written once; the plant's step and the evaluation along a recording call the same ones.

A slot runs through the cards that act in it, in the order of `mechanisms.ALL`: factors multiply, forces add, and what is handed
on goes from one to the next. Their code is made from the cards when this module is loaded. Six further slots, "mass",
"gradient", "radii", "inertia", "law" and "tau", act on what is constant in a stop, see `mechanisms.believed_to_true`.
"""

from collections.abc import Callable, Iterable
from typing import Any

from wsp_env.compiled import generated, inlined
from wsp_env.contact.port import traction
from wsp_env.contact.traction import Adhesion, Surface
from wsp_env.plant.card import SLOTS, Card, Doing, Moment
from wsp_env.plant.mechanisms import ALL, Active

#: How each generated slot runs through its cards: what comes before, what each does, what is returned.
_FORMS: dict[str, tuple[str, str, str]] = {}


def slot_kernel(name: str, cards: Iterable[Card]) -> Callable[..., Any]:
    """Return the kernel of a slot in which only these cards act: its start, then the call of each, then the result.

    The slot takes `active` and its arguments of `SLOTS`; so do the cards' functions, with their own part of `active`.
    """
    arguments = SLOTS[name]
    start, each, result = _FORMS[name]
    lines, kernels = [start], {}
    for card in cards:
        if name in card.acts:
            own = [f"active.parameters.{card.name}"]
            own += [f"active.derived.{card.name}"] if card.derive else []
            own += [f"active.memory.{card.name}"] if card.memory else []
            kernels[card.name] = card.acts[name]
            lines.append(each.format(call=f"{card.name}({', '.join(own)}, {arguments})"))
    body = "".join(f"    {line}\n" for line in [*lines, f"return {result}"] if line)
    return generated(name, f"def {name}(active, {arguments}):\n{body}", kernels)


def acts_kernel(name: str, cards: Iterable[Card]) -> Callable[..., Any]:
    """Return the kernel (active) -> bool: whether one of these mechanisms is on and acts in a slot.

    What only such mechanisms ask for need not be computed for a vehicle without them.
    """
    sizes = [
        f"active.parameters.{card.name}.{size.name} != {size.null!r}"
        for card in cards
        if name in card.acts
        for size in card.sizes
    ]
    return generated(f"{name}_acts", f"def {name}_acts(active):\n    return {' or '.join(sizes) or 'False'}\n", {})


def _slot(name: str, start: str, each: str, result: str) -> Callable[..., Any]:
    _FORMS[name] = start, each, result
    return slot_kernel(name, ALL.values())


def _acts(name: str) -> Callable[..., Any]:
    return acts_kernel(name, ALL.values())


def _factor(name: str) -> Callable[..., Any]:
    return _slot(name, "value = 1.0", "value *= {call}", "value")


def _handed_on(name: str, what: str) -> Callable[..., Any]:
    return _slot(name, "", f"{what} = {{call}}", what)


#: What is noticed of an axle before its contact is evaluated, and whether anything is.
before_contact = _slot("before_contact", "", "{call}", "None")
before_contact_acts = _acts("before_contact")
#: Factor of mu_cd [-] at a place [m].
_contaminated_friction = _factor("contaminated_friction")
#: Factors of mu_cd and of mu_cr [-] at a running speed [m/s].
_friction = _factor("friction")
_recovered_friction = _factor("recovered_friction")
#: Shares of the contaminant layer [-], free and held, at a place [m] which the wheel reached after rolling `rolled` [m].
_layer = _handed_on("layer", "layer, held")
#: Factor of both friction coefficients [-] under axle k.
_axle_friction = _factor("axle_friction")
#: Recovery rate [m/J] under axle k, handed on: (active, i, k, tau).
recovery = _handed_on("recovery", "tau")
#: The contact's adhesion, from that of the law.
changed_contact = _handed_on("contact", "adhesion")
#: Load of one wheel [N] of axle k, from the vehicle's mass [kg] and deceleration [m/s2].
_wheel_load = _handed_on("wheel_load", "load")
#: Force [N] against the motion beside the wheels, added to the believed one [N].
_force = _slot("force", "total = believed", "total += {call}", "total")

#: Brake torque of axle k over the believed one [-], from wheel speed [m/s] and cylinder pressure [bar]: (active, i, k, ...).
torque_factor = _factor("torque_factor")
#: True torque of axle k's brake [N m], from what the factors left of the believed one, by what the axle is doing.
_torque = _handed_on("torque", "torque")
#: Whether any mechanism changes it.
torque_acts = _acts("torque")
#: Reading of a wheel-speed sensor [rad/s] from the last reading, the last and the present true speed and the time between [s].
reading = _handed_on("reading", "now")
#: True wheel speed [rad/s] from a reading and its rate [rad/s2].
wheel_speed = _handed_on("wheel_speed", "wheel")
#: Reading of axle k's wheel-speed sensor over the true speed [-], from the circumferential speed [m/s] and the time [s].
reading_factor = _factor("reading_factor")
#: Recorded vehicle speed [m/s] from the true one, its rate [m/s2] and the time since the start [s], and the other way round.
recorded_speed = _handed_on("recorded_speed", "speed")
true_speed = _handed_on("true_speed", "speed")
#: What is remembered of a contact: rolled [m] since the last, share of the layer that the wheel's work leaves [-].
after_contact = _slot("after_contact", "", "{call}", "None")
#: What is remembered of an axle's `Passage`.
after_passage = _slot("after_passage", "", "{call}", "None")


@inlined
def wheel_load(i: int, k: int, mass: float, deceleration: float, static: float, active: Active) -> float:
    """Load of one wheel of axle k [N] under the vehicle's deceleration [m/s2]; `static` at rest [N]."""
    load: float = _wheel_load(active, i, k, static, mass, deceleration)
    return load


@inlined
def surface(
    i: int, k: int, place: float, rolled: float, mu_cd: float, layer: float, mu_cr: float, active: Active
) -> Surface:  # fmt: skip
    """Return what a wheel finds at a place [m], having rolled `rolled` [m] since the last look.

    mu_cd and layer are what lies there before the mechanisms of the place, of earlier wheels and of the wheel's own past.
    """
    mu_cd *= _contaminated_friction(active, place)
    layer, held = _layer(active, i, k, place, rolled, layer, 0.0)
    factor = _axle_friction(active, i, k)
    return Surface(factor * min(mu_cd, mu_cr), factor * mu_cr, layer, held)


@inlined
def at_speed(speed: float, on: Surface, active: Active) -> Surface:
    """Return what a wheel finds on the rail at a running speed [m/s]."""
    mu_cr = on.mu_cr * _recovered_friction(active, speed)
    return Surface(min(on.mu_cd * _friction(active, speed), mu_cr), mu_cr, on.layer, on.held)


@inlined
def contact(slip: float, speed: float, load: float, on: Surface, tau: float, law: Any, active: Active) -> Adhesion:
    """Adhesion of one wheel at |slip| [m/s], running speed [m/s] and load [N]."""
    here = at_speed(speed, on, active)
    adhesion: Adhesion = changed_contact(active, traction(slip, speed, load, here, tau, law), slip, speed, load)
    return adhesion


@inlined
def torque(i: int, k: int, believed: float, doing: Doing, active: Active) -> float:
    """Torque of axle k's brake [N m]; a mechanism takes away no more than all of it."""
    value: float = _torque(active, i, k, believed, doing)
    return max(value, min(believed, 0.0))  # a measured torque may lie below zero


@inlined
def resistance(i: int, speed: float, believed: float, moment: Moment, active: Active) -> float:
    """Force [N] against the motion beside the wheels; `believed` is that of running resistance and gradient [N]."""
    total: float = _force(active, i, speed, believed, moment)
    return total


#: The kernels of this module that are made from the cards, by slot.
FROM_CARDS: dict[str, Callable[..., Any]] = {
    "before_contact": before_contact,
    "contaminated_friction": _contaminated_friction,
    "friction": _friction,
    "recovered_friction": _recovered_friction,
    "layer": _layer,
    "axle_friction": _axle_friction,
    "recovery": recovery,
    "contact": changed_contact,
    "wheel_load": _wheel_load,
    "force": _force,
    "torque_factor": torque_factor,
    "torque": _torque,
    "reading": reading,
    "wheel_speed": wheel_speed,
    "reading_factor": reading_factor,
    "recorded_speed": recorded_speed,
    "true_speed": true_speed,
    "after_contact": after_contact,
    "after_passage": after_passage,
}
#: The same of those that say whether anything acts there.
ACTING: dict[str, Callable[..., Any]] = {"before_contact": before_contact_acts, "torque": torque_acts}
