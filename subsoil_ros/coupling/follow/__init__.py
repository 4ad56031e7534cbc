"""Following a machine that does not wait: its poses, and the time that the soil takes from them."""

BEHIND_S = 0.2
"""How far the soil falls behind before it skips: a person at a joystick notices a delay of 0.2 s."""

FASTEST_M_PER_S = 10.0
"""Speed beyond which two poses are a leap: knives of a rotary tiller move at 5 m/s."""
