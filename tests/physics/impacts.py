"""Laws and small laboratories for tests of single impacts."""

from tests.soils import NEGLIGIBLE


def hertz(young, nu, restitution, friction, wall=None):
    """A `hertz_mindlin` law; `wall` (Young's modulus, nu) stands for the boundary."""
    row = {
        "youngs_modulus_pa": young, "poisson_ratio": nu, "restitution": restitution,
        "static_friction": friction, "sliding_friction": friction, "rolling_friction": NEGLIGIBLE,
    }  # fmt: skip
    young, nu = wall or (young, nu)
    return {
        "kind": "hertz_mindlin",
        "particle": row,
        "boundary": row | {"youngs_modulus_pa": young, "poisson_ratio": nu},
    }


def laboratory(soil, law, radius, density, step_ns, book=None, length=12.0, **changes):
    """An engine with room for an impact of spheres of this size, without gravity; `length` in radii.

    Hertz's law always keeps its books: the tests need no variant without.
    """
    size = 12.0 * radius
    return soil.engine(
        book=law["kind"] == "hertz_mindlin" if book is None else book,
        soil={
            "bin": {"length_m": length * radius, "width_m": size, "depth_m": size},
            "particles": {"radius_m": radius, "density_kg_per_m3": density},
            "bed": {"kind": "grid", "spacing_m": 2.0 * radius},
            "law": law,
            "time_step_s": step_ns * 1e-9,
            "skin_m": 0.3 * radius,
        },
        **({"gravity_m_per_s2": 0.0} | changes),
    )


def linear(k_n, k_t=NEGLIGIBLE, c_n=0.0, c_t=0.0, mu=0.0, mu_r=NEGLIGIBLE):
    """A `linear` law, the same for particles and boundary: stiffness [N/m], damping [N s/m], frictions."""
    row = {
        "stiffness_newton_per_m": k_n, "tangential_stiffness_newton_per_m": k_t,
        "damping_newton_s_per_m": c_n, "tangential_damping_newton_s_per_m": c_t,
        "static_friction": mu, "sliding_friction": mu, "rolling_friction": mu_r,
    }  # fmt: skip
    return {"kind": "linear", "particle": row, "boundary": row}


def dry_row(*values, **more):
    """The row of `linear` for a cohesive law: adhesion is negligible, and at rest spheres touch."""
    touch = {"equilibrium_overlap_m": 1e-12, "cohesion_range_m": 1e-12}
    return linear(*values, **more)["particle"] | touch | {"cohesive_stiffness_newton_per_m": NEGLIGIBLE}
