"""Magnet forces beside fourth-order elements of NGSolve, at three sizes of our mesh.

    uv run --with ngsolve python -m benchmarks.magnet_fields docs/images/magnet_convergence.png
    uv run --with ngsolve python -m benchmarks.magnet_fields eddies

The sections are meshed by Netgen with the rotor displaced in the geometry, and solved with fourth
order on a mesh that is finer at the gap; the force is that of the stress on a shell of harmonic
weight. Only the outlines and the magnetisation curve are common. Prints deviations of our force and
flux linkage, and the order in which the differences of our meshes fall. With "eddies" it prints the
current stiffness of solid iron over frequency instead.
"""

import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np

from ambkit.machine.magnetostatics.drawing import Drawing
from ambkit.machine.magnetostatics.dynamic_stiffness import FREQUENCIES, dynamic_stiffness
from ambkit.machine.magnetostatics.field import FieldSolver
from ambkit.machine.magnetostatics.layout import flat

FOLDER = Path(__file__).parents[1] / "examples" / "magnets"
MU_0 = 4e-7 * np.pi
FINENESS = 0.5, 1.0, 2.0  #: Of our meshes.
POINTS = ((0.0, 0.0), (0.5, 0.3), (1.0, 0.5))
"""Control current and displacement, in parts of bias current and air gap."""


def refined(outline, circles, displacement=0.0):
    """Return an outline whose steps along circles are halved three times."""
    points = outline
    for _ in range(3):
        following = np.roll(points, -1)
        middle = 0.5 * (points + following)
        keep = np.zeros(len(points), dtype=bool)
        for centre, radius in circles:
            on = [
                np.abs(np.abs(end - centre) - radius) < 1e-7 * radius for end in (points, following)
            ]
            arc = on[0] & on[1] & (np.abs(following - points) < 0.3 * radius)
            out = middle[arc] - centre
            middle[arc] = centre + radius * out / np.abs(out)
            keep |= arc
        points = np.concatenate([[p, m] if k else [p] for p, m, k in
                                 zip(points, middle, keep, strict=True)])  # fmt: skip
    return points + displacement


def ngsolve_mesh(layout, displacement, gap):
    """Return Netgen's mesh; regions are r0, r1, ..., and air around."""
    import ngsolve as ng
    from netgen import occ

    def face(region):
        shift = displacement if region.moves else 0.0
        outline = refined(region.outline, layout.circles, shift)
        if np.imag(np.conj(outline) * np.roll(outline, -1)).sum() < 0:
            outline = outline[::-1]  # Netgen asks for anticlockwise ones
        points = [(float(x), float(y)) for x, y in flat(outline)]
        plane = occ.WorkPlane().MoveTo(*points[0])
        for point in points[1:]:
            plane = plane.LineTo(*point)
        made = plane.Close().Face()
        if region.coil < 0 and region is not layout.boundary:
            made.edges.maxh = 2 * gap
            if len(points) < 40:  # no arcs: its corners are sharp
                made.vertices.maxh = gap / 6
        return made

    faces = [("air", face(layout.boundary))]
    for number, region in enumerate(layout.regions):
        new = face(region)
        faces = [(name, old - new) for name, old in faces] + [(f"r{number}", new)]
    for name, shape in faces:
        shape.faces.name = name
    glued = occ.Glue([shape for _, shape in faces])
    extent = float(np.abs(layout.boundary.outline).max())
    geometry = occ.OCCGeometry(glued, dim=2)
    return ng.Mesh(geometry.GenerateMesh(maxh=0.08 * extent, grading=0.4))


def solved(layout, drawing, currents, displacement, size):
    """Return NGSolve's field with its mesh, space and material."""
    import ngsolve as ng

    mesh = ngsolve_mesh(layout, displacement, size)
    iron, mu_r = drawing.iron.saturation, drawing.iron.relative_permeability
    names = list(mesh.GetMaterials())
    of = {f"r{n}": region for n, region in enumerate(layout.regions)}
    solid = [n for n in names if n != "air" and of[n].iron is not None]
    moving = [n for n in names if n != "air" and of[n].moves]
    coils = [n for n in names if n != "air" and of[n].coil >= 0]
    magnets = {n: of[n] for n in names if n != "air" and of[n].remanence}
    air = [n for n in names if n not in (*solid, *moving, *coils, *magnets)]
    space = ng.H1(mesh, order=4)
    free = space.FreeDofs()
    # The outer boundary: edges of one triangle only.
    edges = {}
    for element in mesh.Elements(ng.VOL):
        for edge in element.edges:
            edges[edge.nr] = edges.get(edge.nr, 0) + 1
    for element in mesh.Elements(ng.BND):
        if all(edges[edge.nr] == 1 for edge in element.edges):
            for dof in space.GetDofNrs(element):
                free[dof] = False
    axial = layout.axisymmetric
    r = ng.x if axial else ng.CoefficientFunction(1.0)
    u, v = space.TnT()
    c = iron / (MU_0 * (mu_r - 1))

    def law(gradient):
        b = ng.sqrt(ng.InnerProduct(gradient, gradient) + 1e-20) / r
        p = 0.5 * (MU_0 * c + iron - b)
        return c / (p + ng.sqrt(p * p + MU_0 * c * b))

    nu = mesh.MaterialCF({n: 1.0 for n in solid}, default=0.0)
    field = ng.BilinearForm(space)
    load = ng.Parameter(0.0)
    area = {
        n: ng.Integrate(ng.CoefficientFunction(1.0), mesh, definedon=mesh.Materials(n))
        for n in coils
    }
    J = mesh.MaterialCF({n: currents[of[n].coil] * of[n].turns / area[n] for n in coils}, default=0)
    recoil = mesh.MaterialCF({n: m.permeability for n, m in magnets.items()}, default=1.0)
    weight = (nu * law(ng.grad(u)) + (1 - nu) / (MU_0 * recoil)) / r
    field += weight * ng.InnerProduct(ng.grad(u), ng.grad(v)) * ng.dx(bonus_intorder=4)
    field += -load * J * v * ng.dx
    sense = -1 if axial else 1
    remanence = [
        mesh.MaterialCF({n: sense * part(m.remanence) for n, m in magnets.items()}, default=0.0)
        for part in (np.real, np.imag)
    ]
    flow = remanence[0] * ng.grad(v)[1] - remanence[1] * ng.grad(v)[0]
    field += -load / (MU_0 * recoil) * flow * ng.dx
    a = ng.GridFunction(space)
    for share in (0.25, 0.5, 0.75, 1.0):
        load.Set(share)
        ng.solvers.Newton(field, a, freedofs=free, maxit=60, maxerr=1e-9, inverse="sparsecholesky",
                          printing=False)  # fmt: skip
    return SimpleNamespace(
        mesh=mesh, free=free, a=a, r=r, iron=nu, law=law(ng.grad(a)), solid=solid, moving=moving,
        coils=coils, magnets=magnets, air=air, of=of, area=area,
        length=2 * np.pi if axial else layout.depth,
    )  # fmt: skip


def shell_of(field, direction):
    """Return the direction and the gradient of a shell's weight, 1 in the rotor."""
    import ngsolve as ng

    shell = ng.H1(field.mesh, order=2)
    g, h = shell.TnT()
    rest = (*field.solid, *field.moving, *field.coils, *field.magnets)
    held = field.mesh.MaterialCF({n: 1e14 for n in rest}, default=0.0)
    one = field.mesh.MaterialCF({n: 1.0 for n in field.moving}, default=0.0)
    matrix = ng.BilinearForm(ng.grad(g) * ng.grad(h) * ng.dx + held * g * h * ng.dx).Assemble()
    right = ng.LinearForm(held * one * h * ng.dx).Assemble()
    gamma = ng.GridFunction(shell)
    gamma.vec.data = matrix.mat.Inverse(shell.FreeDofs(), "sparsecholesky") * right.vec
    return ng.CoefficientFunction((direction.real, direction.imag)), ng.grad(gamma)


def reference(layout, drawing, currents, displacement):
    """Return force and flux linkages by NGSolve."""
    import ngsolve as ng

    field = solved(layout, drawing, currents, displacement, drawing.geometry.air_gap)
    d, gg = shell_of(field, layout.directions[0])
    ga, mesh = ng.grad(field.a), field.mesh
    stress = (ga * gg) * (d * ga) - 0.5 * (ga * ga) * (d * gg)
    force = ng.Integrate(field.length / MU_0 * stress / field.r, mesh, order=10,
                         definedon=mesh.Materials("|".join(field.air)))  # fmt: skip
    flux = np.zeros(layout.bias.size)
    for n in field.coils:
        mean = ng.Integrate(field.a, mesh, order=8, definedon=mesh.Materials(n)) / field.area[n]
        flux[field.of[n].coil] += field.length * field.of[n].turns * mean
    return force, flux, field.a.space.ndof


def harmonic(drawing, frequencies, size):
    """Return the current stiffness at frequencies in parts of that at rest, by NGSolve."""
    import ngsolve as ng

    layout = drawing.layout
    field = solved(layout, drawing, drawing.winding.bias_current * layout.bias, 0.0, size)
    d, gg = shell_of(field, layout.directions[0])
    mesh, r, ga = field.mesh, field.r, ng.grad(field.a)
    # Slope of H over B along the bias field, by Fröhlich's law B = mu0 H + Js H / (c + H).
    c = drawing.iron.saturation / (MU_0 * (drawing.iron.relative_permeability - 1))
    size_b = ng.sqrt(ga * ga + 1e-20) / r
    h = field.law * size_b
    slope = 1 / (MU_0 + drawing.iron.saturation * c / (c + h) ** 2)
    along = (slope - field.law) / (size_b * r) ** 2
    space = ng.H1(mesh, order=4, complex=True)
    u, v = space.TnT()
    gu, gv = ng.grad(u), ng.grad(v)
    weight = field.iron * field.law + (1 - field.iron) / MU_0
    current = mesh.MaterialCF(
        {n: layout.control[0][field.of[n].coil] * field.of[n].turns / field.area[n]
         for n in field.coils}, default=0,
    )  # fmt: skip
    right = ng.LinearForm(current * v * ng.dx).Assemble()
    response, found = ng.GridFunction(space), []
    for frequency in (0.0, *frequencies):
        eddy = 2j * np.pi * frequency * (drawing.iron.conductivity or 0.0)
        form = ng.BilinearForm(space, symmetric=True)
        form += (
            (weight * gu * gv + field.iron * along * (ga * gu) * (ga * gv))
            / r
            * ng.dx(bonus_intorder=4)
        )
        form += eddy * field.iron / r * u * v * ng.dx
        form.Assemble()
        response.vec.data = form.mat.Inverse(field.free, "sparsecholesky") * right.vec
        gr = ng.grad(response)
        stress = (gr * gg) * (d * ga) + (ga * gg) * (d * gr) - (ga * gr) * (d * gg)
        found.append(ng.Integrate(stress / r, mesh, order=10,
                                  definedon=mesh.Materials("|".join(field.air))))  # fmt: skip
    return np.array(found[1:]) / found[0]


def eddies(name):
    """Print the current stiffness over frequency with solid iron, theirs and ours."""
    drawing = Drawing.load(FOLDER / f"{name}.toml").replace(iron__conductivity="4.5e6 S/m")
    frequencies = FREQUENCIES[[0, 2, 3, 4, 5]]
    theirs = harmonic(drawing, frequencies, 0.3 * drawing.geometry.air_gap)
    ours = dynamic_stiffness(drawing, frequencies)[0]
    for frequency, one, other in zip(frequencies, theirs, ours, strict=True):
        off = np.log(other / one)
        print(
            f"{name:>12} {frequency:6.1f} Hz: {abs(one):.4f} at {np.degrees(np.angle(one)):6.2f} "
            f"deg; ours {100 * off.real:+.2f} %, {np.degrees(off.imag):+.2f} deg", flush=True,
        )  # fmt: skip


def compared(name):
    """Print deviations of force and flux linkage of a drawing; return the forces' (points, 3)."""
    drawing = Drawing.load(FOLDER / f"{name}.toml")
    layout, bias, gap = drawing.layout, drawing.bias_current, drawing.geometry.air_gap
    solvers = {fineness: FieldSolver(layout, fineness) for fineness in FINENESS}
    off = []
    for iu, x in POINTS:
        begin = time.perf_counter()
        currents = bias * (layout.bias + iu * layout.control[0])
        displacement = x * gap * layout.directions[0]
        force, flux, dofs = reference(layout, drawing, currents, displacement)
        took = time.perf_counter() - begin
        ours = [solver.at(displacement).solve(currents) for solver in solvers.values()]
        size = max(abs(force), 1e-3 * drawing.magnet_constant * (bias / gap) ** 2)
        off.append([(s.force[0] - force) / size for s in ours])
        linked = [np.abs(s.flux - flux).max() / np.abs(flux).max() for s in ours]
        print(
            f"{name:>13} iu {iu:.1f} x {x:.1f}: F {force:9.3f} N of {dofs} unknowns "
            f"({took:.0f} s); ours "
            + " ".join(f"{100 * o:+.3f}" for o in off[-1])
            + " %; flux "
            + " ".join(f"{100 * o:.3f}" for o in linked)
            + " %",
            flush=True,
        )
    return np.array(off)


def figure(path, deviations):
    """Draw the force's deviation over the length of edges, and the line of second order."""
    from matplotlib.figure import Figure

    lengths = 1 / np.array(FINENESS)
    sheet = Figure(figsize=(5.6, 3.8), layout="constrained")
    axes = sheet.subplots()
    for number, (name, off) in enumerate(deviations.items()):
        worst = 100 * np.abs(off[1:]).max(axis=0)  # of the points with a force
        axes.loglog(lengths, worst, "osv^D*Px"[number % 9] + "-", label=name.replace("_", " "))
    axes.loglog(lengths, 0.05 * lengths**2, "k--", label="second order")
    axes.set_xticks(lengths, [f"{length:g}" for length in lengths], minor=False)
    axes.minorticks_off()
    axes.set_xlabel("length of edges, in parts of the usual mesh")
    axes.set_ylabel("deviation of the force [%]")
    axes.legend(fontsize=8, ncols=2)
    sheet.savefig(path, dpi=150)


def main(arguments):
    """Print the comparison of drawings by name, of all without; FILE.png is drawn with it."""
    names = [name for name in arguments if not name.endswith(".png")]
    plane = [path.stem for path in sorted(FOLDER.glob("*.toml"))]
    deviations = {}
    for name in names or [name for name in plane if name != "homopolar"]:  # not of one section
        deviations[name] = off = compared(name)
        steps = np.abs(np.diff(off[1:], axis=1)).mean(axis=0)
        print(f"{name:>13} observed order {np.log2(steps[0] / steps[1]):.1f}", flush=True)
    for path in {*arguments} - {*names}:
        figure(path, deviations)


if __name__ == "__main__":
    if sys.argv[1:2] == ["eddies"]:
        eddies("thrust")
    else:
        main(sys.argv[1:])
