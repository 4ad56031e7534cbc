"""Units in names, and the fields of a message text."""

from subsoil_ros.units import UNITS

ENDINGS = sorted((*UNITS, "rad_per_s2", "count"), key=len, reverse=True)


def unit_of(name: str) -> str:
    """The unit that a name ends in, "newton_m" of "moment_newton_m"; empty if there is none."""
    return next((unit for unit in ENDINGS if name.endswith(f"_{unit}")), "")


def field_lines(text: str) -> list[tuple[str, str, str]]:
    """Fields of a message text: (type, name, comment). Comments, constants and blank lines are left out."""
    found = []
    for line in text.splitlines():
        declaration, _, comment = line.partition("#")
        if declaration.strip() and "=" not in declaration:
            kind, name = declaration.split()
            found.append((kind, name, comment))
    return found
