"""The longitudinal plant as a unit of C: one vehicle, commands in, what its sensors say and what is out."""

import dataclasses
from collections import namedtuple
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from wsp_env.compiled import generated
from wsp_env.contact import port
from wsp_env.export import kinds
from wsp_env.export.translator import Direct, Translator
from wsp_env.export.unit import Unit, Variable, assigned, flat
from wsp_env.export.writer import Writer
from wsp_env.parameters.quantity import ParameterError
from wsp_env.parameters.vehicle import Vehicle
from wsp_env.plant import mechanisms as library
from wsp_env.plant import slots
from wsp_env.plant.card import Card
from wsp_env.plant.longitudinal import interval, step
from wsp_env.plant.longitudinal.plant import LongitudinalPlant
from wsp_env.plant.longitudinal.state import batch
from wsp_env.plant.port import LIMITS, Choice, Setup, Stop

#: Untyped: the names of the fields are known when it runs.
_named_tuple: Any = namedtuple

#: Slots on what a caller gives as a parameter himself.
_GIVEN = ("mass", "gradient", "radii", "tau")

_TRUTHS = {
    "time": ("s", "since the start of the stop"),
    "position": ("m", "of the leading axle along the track"),
    "speed": ("m/s", "of the vehicle"),
    "deceleration": ("m/s2", "of the vehicle"),
    "distributor": ("bar", "pressure that the distributor gives"),
    "brake_work": ("J", "heat in discs and pads"),
    "resistance_work": ("J", "against running resistance and gradient"),
}
_PER_AXLE = {
    "wheel_speed": ("rad/s", "true wheel speed"),
    "slip_speed": ("m/s", "v - r w"),
    "pressure": ("bar", "in the brake cylinder"),
    "adhesion": ("1", "f = T / N, signed as the slip"),
    "air": ("Nl", "let into the cylinder"),
    "contact_work": ("J", "heat in both contacts of the wheelset"),
}


@dataclasses.dataclass(frozen=True)
class PlantOptions:
    """How a plant is exported.

    Parameters
    ----------
    control_interval_s
        Time of one step [s].
    pressure_control
        Commands are shares of the demanded pressure, 0 to 1, instead of valve commands.
    track_nodes
        Nodes of mu_cd and coverage along the track; 1: the same everywhere.
    track_step_m
        Distance of the nodes [m].

    """

    control_interval_s: float = 0.02
    pressure_control: bool = False
    track_nodes: int = 1
    track_step_m: float = 5.0


def plant_unit(vehicle: Vehicle, options: PlantOptions | None = None, mechanisms: Choice | None = None) -> Unit:
    """Return the unit of a vehicle's plant; `ParameterError` for a mechanism that acts on what is a parameter in C."""
    o = options or PlantOptions()
    setup = Setup(
        o.control_interval_s, mechanisms=mechanisms or {}, pressure_control=o.pressure_control, track_step_m=o.track_step_m,
        track_nodes=o.track_nodes,
    )  # fmt: skip
    cards = [library.ALL[name] for name in library.ALL if name in setup.mechanisms]
    example = _example(vehicle, setup, cards)
    t = Translator("wsp_plant", _replaced(vehicle, cards))
    own = t.type_of(example)
    assert isinstance(own, kinds.Record)
    shape = (kinds.BATCH, vehicle.axles)
    call = t.call(
        step.advance,
        [
            kinds.variable(kinds.Array(kinds.REAL, shape, const=True), "u->command"),
            kinds.known(None),
            kinds.variable(own, "self->batch"),
            kinds.variable(kinds.Array(kinds.BOOL, (kinds.BATCH,)), "self->moving"),
            kinds.variable(kinds.Array(kinds.REAL, (step.ROWS, vehicle.axles)), "self->work"),
        ],
        None,
    )
    axles = vehicle.axles
    outputs = (
        *(Variable(name, *said) for name, said in _TRUTHS.items()),
        *(Variable(name, *said, size=axles) for name, said in _PER_AXLE.items()),
        Variable("measured_wheel_speed", "rad/s", "what the wheel-speed sensors say", size=axles),
        Variable("moving", "1", "1 until the vehicle stands"),
    )
    return Unit(
        name="wsp_plant",
        title=f"Longitudinal plant of the {vehicle.name}" + (f" with {', '.join(setup.mechanisms)}" if cards else ""),
        translator=t,
        parameters=_parameters(vehicle, o),
        inputs=(
            Variable(
                "command",
                "1",
                "share of the demanded pressure" if o.pressure_control else "-1 vents, 0 holds, +1 applies",
                (1.0,),
                axles,
            ),
            Variable("demand", "1", "brake demand, share of full pressure", (1.0,)),
        ),
        outputs=outputs,
        state=(f"{own.name} batch;", "bool moving;", f"double work[{step.ROWS}][{axles}];"),
        start=("memset(self, 0, sizeof *self);", *assigned("self->batch", example, own), *_begin(axles, o.track_nodes)),
        read=tuple(_read(axles)),
        step=("self->batch.conditions.demand = u->demand;", f"{call.code};", "wsp_plant_read(self, y);"),
        reference=lambda times: _reference(vehicle, setup, 3 * times),
        interval_s=o.control_interval_s,
        axles=axles,
    )


def _example(vehicle: Vehicle, setup: Setup, cards: Sequence[Card]) -> Any:
    """Return a batch of vehicles with what these mechanisms derive and remember, and nothing of the others."""
    for card in cards:
        if wrong := [slot for slot in _GIVEN if slot in card.acts]:
            raise ParameterError(
                f"mechanism {card.name} acts on {', '.join(wrong)}, which the C takes as a parameter: give it there"
            )
    whole: Any = batch(kinds.SENTINEL, vehicle, setup, library.make(setup.mechanisms))
    own = _named_tuple("Derived", [card.name for card in cards if card.derive])
    remembered = _named_tuple("Memory", [card.name for card in cards if card.memory])
    derived = own(*(getattr(whole.constants.derived, name) for name in own._fields))
    memory = remembered(*(getattr(whole.state.memory, name) for name in remembered._fields))
    rows = whole.physics.mechanisms[:, _columns(cards)] if cards else None
    return whole._replace(
        state=whole.state._replace(memory=memory),
        physics=whole.physics._replace(mechanisms=rows),
        constants=whole.constants._replace(derived=derived),
    )


def _law_reader(law: type) -> Callable[[Sequence[kinds.Value], Writer | None], kinds.Value]:
    def read(given: Sequence[kinds.Value], body: Writer | None) -> kinds.Value:
        assert body is not None
        return body.translator.call(port._READ[law], given[1:], body)

    return read


def _columns(cards: Sequence[Card]) -> list[int]:
    """Return which columns of a row of all mechanisms belong to these."""
    sizes = [len(record) for record in library.NULL]
    starts = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    where = {name: range(start, start + size) for name, start, size in zip(library.ALL, starts[:-1], sizes, strict=True)}
    return [column for card in cards for column in where[card.name]]


def _replaced(vehicle: Vehicle, cards: Sequence[Card]) -> dict[Any, Any]:
    """Return what stands in the place of functions that choose while they are compiled."""
    law = type(vehicle.contact.law)
    own = _named_tuple("Mechanisms", [card.name for card in cards])
    records, column = [], 0
    for card in cards:
        count = len(card.parameters)
        records.append(f"{card.name}({', '.join(f'rows[i, {column + j}]' for j in range(count))})")
        column += count
    text = f"def read_mechanisms(rows, i):\n    return Mechanisms({', '.join(records)})\n"
    reader = generated("read_mechanisms", text, {"Mechanisms": own} | {card.name: card.record for card in cards})
    return {
        interval._batch: Direct(lambda given, body: given[0]),
        port.law_at: Direct(_law_reader(law)),
        port.traction: port._EVALUATE[law],
        library.mechanisms_at: reader if cards else Direct(lambda given, body: kinds.known(None)),
        **{kernel: slots.slot_kernel(name, cards) for name, kernel in slots.FROM_CARDS.items()},
        **{kernel: slots.acts_kernel(name, cards) for name, kernel in slots.ACTING.items()},
    }


def _parameters(vehicle: Vehicle, o: PlantOptions) -> tuple[Variable, ...]:
    def limits(name: str) -> str:
        low, high, _ = LIMITS[name]
        return f"; {low:g} to {high:g}"

    return (
        Variable("mu_cd", "1", "kinetic friction coefficient of the contaminated rail, above 0, at most mu_cr", (0.06,)),
        Variable("tau", "m/J", f"recovery rate{limits('tau')}", (0.0,)),
        Variable("initial_speed", "m/s", f"at the start{limits('initial_speed')}", (vehicle.max_speed_mps,)),
        Variable("mass", "kg", f"of the vehicle with its load, without rotating parts{limits('mass')}", (vehicle.mass_kg,)),
        Variable("gradient", "1", f"rise over distance, positive uphill{limits('gradient')}"),
        Variable("noise", "rad/s", "standard deviation of the wheel-speed sensors"),
        Variable("noise_key", "1", "whole number from which the sensors' noise is computed"),
        Variable("radius", "m", "of the wheels", (vehicle.wheel_radius_m,), vehicle.axles),
        Variable("profile", "1", f"mu_cd along the track over mu_cd, nodes {o.track_step_m:g} m apart", (1.0,), o.track_nodes),
        Variable("coverage", "1", "share of the contaminant layer at the same nodes, 0 clean", (1.0,), o.track_nodes),
    )  # fmt: skip


def _begin(axles: int, nodes: int) -> list[str]:
    """Return how a stop begins, as `LongitudinalPlant.start` has it."""
    loop = f"for (int64_t k = 0; k < {axles}; k++) {{"
    c, s = "self->batch.conditions", "self->batch.state"
    return [
        *(f"{c}.{name} = p->{name};" for name in ("mu_cd", "tau", "mass", "gradient", "noise")),
        f"{c}.demand = 0.0;",
        f"{c}.key = (uint64_t)p->noise_key;",
        f"for (int64_t m = 0; m < {nodes}; m++) {{",
        f"    {c}.profile[m] = p->profile[m];",
        f"    {c}.coverage[m] = p->coverage[m];",
        "}",
        f"{s}.speed = {s}.recorded_speed = p->initial_speed;",
        loop,
        f"    {c}.radius[k] = p->radius[k];",
        f"    {s}.wheel_speed[k] = p->initial_speed / p->radius[k];",
        f"    {s}.slip_speed[k] = p->initial_speed - p->radius[k] * {s}.wheel_speed[k];",
        f"    {s}.tachometer.counted[k] = {s}.tachometer.filtered[k] = {s}.tachometer.measured[k] = {s}.wheel_speed[k];",
        "}",
        "self->moving = true;",
    ]


def _read(axles: int) -> list[str]:
    s = "self->batch.state"
    inside = {"distributor": "brake.distributor", "pressure": "brake.pressure", "air": "brake.air"}
    return [
        *(f"y->{name} = {s}.{inside.get(name, name)};" for name in _TRUTHS),
        f"for (int64_t k = 0; k < {axles}; k++) {{",
        *(f"    y->{name}[k] = {s}.{inside.get(name, name)}[k];" for name in _PER_AXLE),
        f"    y->measured_wheel_speed[k] = {s}.tachometer.measured[k];",
        "}",
        "y->moving = self->moving ? 1.0 : 0.0;",
    ]


def random_stop(vehicle: Vehicle, nodes: int, rng: np.random.Generator) -> Stop:
    """Return the conditions of one stop over the range of use."""
    return Stop(
        mu_cd=float(rng.uniform(0.02, 0.12)),
        tau=float(rng.uniform(0.0, 4e-4)),
        initial_speed=float(rng.uniform(5.0, 45.0)),
        mass=vehicle.mass_kg + float(rng.uniform(0.0, 1.0)) * vehicle.payload_kg,
        demand=1.0,
        gradient=float(rng.uniform(-0.005, 0.005)),
        noise=float(rng.choice([0.0, 0.05])),
        key=int(rng.integers(2**24)),  # whole in a float too
        radius=vehicle.wheel_radius_m * rng.uniform(0.99, 1.0, vehicle.axles),
        profile=rng.uniform(0.7, 1.3, nodes),
        coverage=rng.uniform(0.5, 1.0, nodes),
    )


def stop_parameters(stop: Stop) -> list[float]:
    """Return the parameters of the C for a stop."""
    values = (stop.mu_cd, stop.tau, stop.initial_speed, stop.mass, stop.gradient, stop.noise, float(stop.key))
    return flat((*values, stop.radius, stop.profile, stop.coverage))


def plant_outputs(plant: LongitudinalPlant) -> list[float]:
    """Return the outputs of the C as a plant of one vehicle has them."""
    truth = plant.truth()._asdict()
    measured = plant.reading().wheel_speed
    return flat(([truth[name] for name in (*_TRUTHS, *_PER_AXLE)], measured, plant.moving))


def _reference(
    vehicle: Vehicle, setup: Setup, stops: int, longest: int = 400, seed: int = 0
) -> Iterator[tuple[str, list[float], list[float]]]:
    """Yield stops under commands that hold for random times."""
    rng = np.random.default_rng(seed)
    plant = LongitudinalPlant(vehicle, 1, setup)
    for _ in range(stops):
        stop = random_stop(vehicle, setup.track_nodes, rng)
        plant.start(0, stop)
        yield "start", stop_parameters(stop), []
        command = np.ones((1, vehicle.axles))
        for _ in range(longest):
            change = rng.random(vehicle.axles) < 0.1
            drawn = rng.uniform(0.0, 1.0, vehicle.axles) if setup.pressure_control else rng.integers(-1, 2, vehicle.axles)
            command[0, change] = drawn[change]
            demand = float(rng.choice([1.0, 0.6])) if rng.random() < 0.01 else plant.conditions.demand[0]
            plant.conditions.demand[0] = demand
            plant.step(command)
            yield "step", flat((command, demand)), plant_outputs(plant)
