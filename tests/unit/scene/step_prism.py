"""A STEP file of a prism, as a CAD program exports it: planar faces, straight edges, millimetres."""

import itertools
from collections.abc import Sequence

import numpy as np

UNITS = (
    "(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT(.MILLI.,.METRE.))",
    "(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.))",
    "(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT())",
    "UNCERTAINTY_MEASURE_WITH_UNIT(LENGTH_MEASURE(1.E-06),#1,'','')",
    "(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNCERTAINTY_ASSIGNED_CONTEXT((#4))"
    "GLOBAL_UNIT_ASSIGNED_CONTEXT((#1,#2,#3))REPRESENTATION_CONTEXT('',''))",
)
HEADER = (
    "ISO-10303-21;\nHEADER;\nFILE_DESCRIPTION((''),'2;1');\nFILE_NAME('','',(''),(''),'','','');\n"
    "FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));\nENDSEC;\nDATA;\n"
)


def step_prism(polygon_mm: Sequence[tuple[float, float]], width_mm: float) -> str:
    """The prism of a polygon in x and z, anticlockwise seen from its right (-y), drawn out along y."""
    lines = list(UNITS)

    def add(text: str) -> str:
        lines.append(text)
        return f"#{len(lines)}"

    def point(place: Sequence[float]) -> str:
        return add(f"CARTESIAN_POINT('',({','.join(repr(float(c)) for c in place)}))")

    def direction(along: Sequence[float]) -> str:
        unit = np.asarray(along, float) / np.linalg.norm(along)
        return add(f"DIRECTION('',({','.join(repr(float(c)) for c in unit)}))")

    count, half = len(polygon_mm), 0.5 * width_mm
    places = [np.array([x, y, z]) for y in (-half, half) for x, z in polygon_mm]
    vertices = [add(f"VERTEX_POINT('',{point(place)})") for place in places]
    edges: dict[tuple[int, int], str] = {}

    def oriented(i: int, j: int) -> str:
        if (i, j) not in edges and (j, i) not in edges:
            along = places[j] - places[i]
            vector = add(f"VECTOR('',{direction(along)},{float(np.linalg.norm(along))!r})")
            line = add(f"LINE('',{point(places[i])},{vector})")
            edges[i, j] = add(f"EDGE_CURVE('',{vertices[i]},{vertices[j]},{line},.T.)")
        edge, same = (edges[i, j], ".T.") if (i, j) in edges else (edges[j, i], ".F.")
        return add(f"ORIENTED_EDGE('',*,*,{edge},{same})")

    faces = []
    sides = [[(i + 1) % count, i, count + i, count + (i + 1) % count] for i in range(count)]
    for loop in ([*range(count)], [*reversed(range(count, 2 * count))], *sides):
        corners = [places[k] for k in loop]
        normal = sum(np.cross(a, b) for a, b in itertools.pairwise([*corners, corners[0]]))
        around = ",".join(oriented(i, j) for i, j in itertools.pairwise([*loop, loop[0]]))
        edge_loop = add(f"EDGE_LOOP('',({around}))")
        bound = add(f"FACE_OUTER_BOUND('',{edge_loop},.T.)")
        axes = f"{point(corners[0])},{direction(normal)},{direction(corners[1] - corners[0])}"
        placed = add(f"AXIS2_PLACEMENT_3D('',{axes})")
        plane = add(f"PLANE('',{placed})")
        faces.append(add(f"ADVANCED_FACE('',({bound}),{plane},.T.)"))
    shell = add(f"CLOSED_SHELL('',({','.join(faces)}))")
    solid = add(f"MANIFOLD_SOLID_BREP('',{shell})")
    axes = add(f"AXIS2_PLACEMENT_3D('',{point((0, 0, 0))},{direction((0, 0, 1))},{direction((1, 0, 0))})")
    shape = add(f"ADVANCED_BREP_SHAPE_REPRESENTATION('',({axes},{solid}),#5)")
    context = add("APPLICATION_CONTEXT('automotive_design')")
    kind = add(f"PRODUCT_CONTEXT('',{context},'mechanical')")
    product = add(f"PRODUCT('tine','tine','',({kind}))")
    formation = add(f"PRODUCT_DEFINITION_FORMATION('','',{product})")
    view = add(f"PRODUCT_DEFINITION_CONTEXT('part definition',{context},'design')")
    definition = add(f"PRODUCT_DEFINITION('design','',{formation},{view})")
    whole = add(f"PRODUCT_DEFINITION_SHAPE('','',{definition})")
    add(f"SHAPE_DEFINITION_REPRESENTATION({whole},{shape})")
    body = "\n".join(f"#{k}={line};" for k, line in enumerate(lines, 1))
    return f"{HEADER}{body}\nENDSEC;\nEND-ISO-10303-21;\n"
