"""Parts that small machines of the mechanism's tests are made of, and what is asked of them."""

MASS, INERTIA = 2.0, 0.3


def advance(engine, ticks):
    """The engine after so many ticks without wrenches."""
    for tick in range(ticks):
        engine.advance(tick, ())
    return engine


def book(state):
    """What is stored and lost, less the work that came in [J]: it stays."""
    stored = state.kinetic_energy_joule + state.gravity_energy_joule + state.spring_energy_joule
    return stored + state.dissipated_joule - state.driver_work_joule - state.external_work_joule


def body(x=0.0, z=0.0, **rest):
    """A body at a place."""
    return {"mass_kg": MASS, "inertia_kg_m2": INERTIA, "position_m": (x, z), **rest}
