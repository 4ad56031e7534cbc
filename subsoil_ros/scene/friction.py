"""Friction of joints: Coulomb's law, either smoothed at low speed or with sticking."""

from pydantic import Field, model_validator

from ..strict_model import NonNegative, Positive, StrictModel

STICKS = (
    "left out: friction grows with the speed and creeps. Given: Coulomb's law, a spring and damper up to the "
    "limit, then sliding at the limit, without creep; slip_speed is not used."
)


def check_stick(part: StrictModel, stiffness: str, damping: str) -> None:
    """Refuse stick damping without stick stiffness; the arguments are the units in the keys."""
    if (
        getattr(part, f"stick_damping_{damping}") > 0.0
        and getattr(part, f"stick_stiffness_{stiffness}") is None
    ):
        raise ValueError(f"stick_damping_{damping} needs a stick_stiffness_{stiffness}")


class RotationFriction(StrictModel):
    """Moment (preload + coefficient * radius * force in the pin) * tanh(turning speed / slip speed)."""

    preload_newton_m: NonNegative = Field(0.0, description="limit without a force in the pin.")
    coefficient: NonNegative = Field(0.0, description="of the force in the pin; needs radius_m.")
    radius_m: NonNegative = Field(0.0, description="of the pin.")
    slip_speed_rad_per_s: Positive = Field(0.01, description="at which friction reaches 76 % of its limit.")
    stick_stiffness_newton_m_per_rad: Positive | None = Field(None, description=STICKS)
    stick_damping_newton_m_s_per_rad: NonNegative = Field(0.0, description="while it sticks.")

    @model_validator(mode="after")
    def _whole(self) -> "RotationFriction":
        if (self.coefficient > 0.0) != (self.radius_m > 0.0):
            raise ValueError("coefficient and radius_m are needed together")
        check_stick(self, "newton_m_per_rad", "newton_m_s_per_rad")
        return self


class TranslationFriction(StrictModel):
    """Force (preload + coefficient * force across the line) * tanh(sliding speed / slip speed)."""

    preload_newton: NonNegative = Field(0.0, description="limit without a force across the line.")
    coefficient: NonNegative = Field(0.0, description="of the force across the line.")
    slip_speed_m_per_s: Positive = Field(0.01, description="at which friction reaches 76 % of its limit.")
    stick_stiffness_newton_per_m: Positive | None = Field(None, description=STICKS)
    stick_damping_newton_s_per_m: NonNegative = Field(0.0, description="while it sticks.")

    @model_validator(mode="after")
    def _whole(self) -> "TranslationFriction":
        check_stick(self, "newton_per_m", "newton_s_per_m")
        return self
