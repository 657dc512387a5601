"""From a case to a discrete problem, the same way in 2D and 3D."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cutbench.base.errors import BadInput
from cutbench.case.case import Case
from cutbench.case.model import Model
from cutbench.case.motion import Motion
from cutbench.forms.base import Form
from cutbench.forms.bending import BendingForm
from cutbench.forms.blade import BladeForm, ContactNumerics
from cutbench.forms.bulk import BulkForm
from cutbench.forms.cut import CutForm
from cutbench.forms.damping import DampingForm
from cutbench.forms.geometry import Geometry, paired
from cutbench.forms.gradient import GradientForm
from cutbench.forms.mixed import MixedVolumetric
from cutbench.forms.prisms import Prisms, Sheared
from cutbench.forms.self_contact import SelfContactForm
from cutbench.forms.space import Faces, Space
from cutbench.forms.support import SupportForm
from cutbench.forms.surface import Rim, Share, SurfaceForm
from cutbench.forms.surface_lines import surface_lines
from cutbench.forms.tension import HeldForm, SpanForm, TensionForm
from cutbench.mechanisms import Skin, Volumetric
from cutbench.models2d.plane_strain import geometry as section_geometry
from cutbench.models3d.block import geometry as block_geometry
from cutbench.models3d.block import part_of
from cutbench.models3d.extruded import drawn_out
from cutbench.solver.iterative import rigid_motions
from cutbench.solver.march import March
from cutbench.solver.newton import NewtonSettings
from cutbench.solver.predictor.history import History
from cutbench.solver.predictor.window import Window
from cutbench.solver.problem import Problem
from cutbench.solver.step_control import StepRules

#: So far from the plane of the cut, in blade thicknesses, the top is kept off the cut faces.
WIDE = 5.0
#: Polynomial order of the displacements.
ORDER = {"P1": 1, "P2": 2, "P2P1": 2}
#: Quadrature degree in quadratic elements. With 2, exact where strains are small, the mixed one begins to cut
#: a tenth too early, and the other snaps where nothing snaps: beside the cut it is stretched several times.
DEGREE = {"P2": 4, "P2P1": 4}


@dataclass(frozen=True)
class Built:
    """A problem ready to march, and what is needed to read its results."""

    case: Case
    geometry: Geometry
    space: Space
    problem: Problem
    march: March

    def form(self, name: str):
        return next(form for form in self.problem.forms if form.name == name)

    @property
    def blades(self) -> list[BladeForm]:
        return self.problem.blades


def geometry_of(case: Case, **where) -> Geometry:
    """Mesh and names for the case's dimension; in 2D ``where`` says which elements are small."""
    tool, n = case.model.tool, case.numerics
    radius = np.inf if tool is None else tool.edge_radius(case.p)
    across, _, even = case.model.mirrored(case.p)
    if n.symmetry == "auto" and not (across and (tool is None or tool.alike(case.p))):
        n = replace(n, symmetry="full")
    if case.dim == 2:
        section = section_geometry(case.values, n, radius, case.sizes.detail_mm, **where)
        # What has no mirror image along the blade moves there, too.
        return replace(section, sheared=case.p.slice_push > 0 or not even)
    if not n.layers or n.mesh is not None:
        return block_geometry(case.values, n, radius, even)
    if n.element == "P2P1":
        raise BadInput(
            key="element", value="P2P1", expected="P2 or P1 where a section is drawn out in layers"
        )
    part = part_of(case.values, n, even)
    flat = replace(n, symmetry="full" if part == "full" else "half")
    # No cut is deeper than the blade.
    section = section_geometry(
        case.values, flat, radius, case.sizes.detail_mm, **({"fine": (0.0, case.p.depth)} | where)
    )
    return drawn_out(section, case.values["length"], n.layers, n.layer_ratio, part)


def space_of(geometry: Geometry, order: int) -> Space:
    """Displacements of an ``order`` on a mesh."""
    if geometry.section is None or geometry.planes is None:
        flat = Space.build(geometry.mesh, order)
        return Sheared.over(flat) if geometry.sheared else flat
    return Prisms.of(geometry.mesh, Space.build(geometry.section, order), geometry.planes)


def contact_numerics(case: Case, model: Model, p) -> ContactNumerics:
    """Stiffnesses of the contact for parameters ``p`` of a ``model``, some complex; sizes are held."""
    n, sizes = case.numerics, case.sizes
    modulus, carried, per_cell = model.shear_modulus(p), n.multiplier == "carried", n.scaled == "cell"
    # Per cell they are divided by its diameter in place of the detail.
    normal, stick = ((sizes.detail_mm if per_cell else 1) * each * modulus
                     for each in (sizes.penalty_per_mm, sizes.stick_per_mm))  # fmt: skip
    return ContactNumerics(normal, stick, n.normal, n.gap, carried, sizes.release_mm, per_cell)


def damping_viscosity(case: Case, p):
    """Viscosity of the damping form for parameters ``p``, MPa s."""
    return case.model.shear_modulus(p) * case.sizes.damping_mm / p.speed


def build(case: Case, geometry: Geometry | None = None, space: Space | None = None) -> Built:
    """Forms, pattern, solver and march of a case. Raises BadInput for a mesh that cannot be used.

    ``geometry`` and the ``space`` on its mesh are the case's unless given.
    """
    geometry = geometry or geometry_of(case)
    space = space or space_of(geometry, ORDER[case.numerics.element])
    forms, ndof = _forms(case, geometry, space)
    # A section is small, and the mixed element's matrix no elasticity alone: both are factorized.
    modes = rigid_motions(space.X) if case.dim == 3 and ndof == space.ndof else None
    fixed = _fixed(case.model, geometry, space, forms)
    tool, solver = case.model.tool, case.numerics.solver
    problem = Problem(forms, ndof, fixed, case.p, solver=solver, modes=modes, pulled=tool is None)
    return Built(case, geometry, space, problem, _march(case, geometry, space, problem))


def _forms(case: Case, geometry: Geometry, space: Space) -> tuple[list[Form], int]:
    """All that holds a specimen together and meets it, and how many unknowns that has."""
    p, n, model = case.p, case.numerics, case.model
    degree = 1 if space.order == 1 else n.bulk_degree or DEGREE[n.element]
    volume = space.volume(degree)
    bulk, skins, cut = (model.laws(slot) for slot in ("bulk", "skin", "cut"))
    forms: list[Form] = []
    if n.element == "P2P1":
        pressure = next((law for law in bulk if isinstance(law, Volumetric)), None)
        if pressure is None:
            raise BadInput(
                key="element", value="P2P1", expected="P1 or P2 in a model without a law for volume change"
            )
        forms.append(MixedVolumetric(pressure, space, degree, p.height, skins))
        bulk = tuple(law for law in bulk if law is not pressure)
    forms.insert(0, BulkForm(bulk, volume, p.height, skins))
    ndof = getattr(forms[-1], "ndof", space.ndof)
    faces = {name: space.faces(name, n.facet_degree) for name in geometry.blade_faces}
    if cut:
        minus = paired(faces["cut"], faces["cut_minus"], space.X) if geometry.split else None
        forms.append(CutForm(cut, faces["cut"], p.height, minus, skins, n.closing))
    elif geometry.split:
        raise BadInput(
            key="symmetry", value="full", expected="'half' where no law holds the cut plane together"
        )
    forms += surfaces_of(skins, space, geometry, faces, bool(cut), n.facet_degree)
    # Without contact nothing meets the blade: neither friction nor adhesion then has a surface to act on.
    if model.tool is not None:
        met, kept = Faces.joined(list(faces.values())), [name for name in faces if name != "top"]
        contact = contact_numerics(case, model, p)
        forms.append(BladeForm(model.laws("blade"), met, contact, keep_touched=kept, height=p.height))
    met_itself = case.dim == 2 and n.self_contact == "on"
    if met_itself and (lines := surface_lines(faces, space.X, WIDE * p.thickness)):
        forms.append(SelfContactForm(lines, space.X, model.laws("bulk"), p.thickness, n.tuning.self_contact))
    if case.sizes.damping_mm > 0:
        forms.append(DampingForm(volume, damping_viscosity(case, p)))
    for law in model.laws("support"):
        support = SupportForm(law, space.faces(geometry.clamped, 2 * space.order), ndof)
        forms.append(support)
        ndof = support.ndof
    return forms, ndof


def _fixed(model: Model, geometry: Geometry, space: Space, forms: Sequence[Form]) -> np.ndarray:
    """The unknowns that stay 0: of the clamp and of the planes of symmetry."""
    dim, clamped = space.dim, space.nodes_on(geometry.clamped)
    support = next((form for form in forms if isinstance(form, SupportForm)), None)
    fixed = [clamped * dim + i for i in range(dim) if i == 1 or support is None]
    fixed += [space.nodes_on(name) * dim + i for name, i in geometry.held]
    if not model.laws("cut") and not geometry.split:
        fixed.append(space.nodes_on("cut") * dim)  # nothing to open: the plane stays a symmetry plane
    if support is not None:  # what symmetry holds needs no traction
        traction, held = support.pairs
        fixed.append(traction[np.isin(held, np.concatenate(fixed))])
    return np.unique(np.concatenate(fixed))


def _march(case: Case, geometry: Geometry, space: Space, problem: Problem) -> March:
    p, n, tuned, sizes = case.p, case.numerics, case.numerics.tuning, case.sizes
    rules = StepRules(
        **vars(tuned.steps.sized(case.unit_mm)),
        largest=sizes.step_mm,
        smallest=sizes.step_min_mm,
        damage=n.damage_step,
        defect=n.energy_step,
        augmentations=n.augmentations,
        staggered=n.scheme == "staggered",
        paper=n.stepping == "paper",
    )
    past = window = None
    if problem.cut is not None and n.predictor == "front" and n.scheme == "monolithic":
        cut = problem.cut.faces
        # Tetrahedra are too few for a surge to be so well resolved.
        if space.dim == 2 or isinstance(space, Prisms):
            past = History(space, cut, problem.ndof, tuned.window.remembered)
        window = Window(problem, space, cut, p.thickness, past, tuned.window)
    return March(
        problem,
        np.array([0.0, p.height, 0.0]),  # the tip touches the top
        Motion(p.depth, p.speed, case.motion, p.slice_push),
        space.nodes_on(geometry.clamped) * space.dim + 1,
        rules,
        NewtonSettings(**vars(tuned.newton.sized(case.unit_mm)), tolerance=n.tolerance),
        past,
        window,
    )


def surfaces_of(skins, space: Space, geometry: Geometry, faces, opens: bool, degree: int) -> Iterator[Form]:
    """``surface_forms``, or, of a section that is drawn out, those of the section in each plane."""
    if not isinstance(space, Prisms):
        yield from surface_forms(skins, space, geometry, faces, opens)
        return
    flat = {name: space.flat.faces(name, degree) for name in faces}
    section = replace(geometry, held=(), mesh=space.flat.mesh)
    for form in surface_forms(skins, space.flat, section, flat, opens):
        assert isinstance(form, SurfaceForm), "what a surface has is a form of surfaces"
        yield space.stacked(form, flat["cut"])


def surface_forms(
    skins: Sequence[Skin], space: Space, geometry: Geometry, faces: Mapping[str, Faces], opens: bool
) -> Iterator[Form]:
    """Forms of the laws that surfaces have; ``opens``: some law lets the cut plane open."""
    if not any(law.surfaces for law in skins):
        return
    X, cut = space.X, faces["cut"]
    sides = {"cut": cut} | ({"cut_minus": paired(cut, faces["cut_minus"], X)} if geometry.split else {})
    rim = Rim.of(faces["top"], cut, sides.get("cut_minus"), X)
    mirrors = [(space.nodes_on(name), i) for name, i in geometry.held]
    for law in skins:
        on = {name: faces[name] for name in law.surfaces if name == "top"}
        on |= sides if "cut" in law.surfaces and opens else {}
        for name, side in on.items():
            end = rim if name == "top" and law.continuous else None
            if type(law).bending is not Skin.bending:
                yield BendingForm(f"{law.name} bent {name}", law, side, X, mirrors, end)
            if type(law).gradient is not Skin.gradient:
                yield GradientForm(f"{law.name} uneven {name}", law, side, X, mirrors, end)
            if type(law).tension is not Skin.tension:
                share = Share.all_of(side.w.size) if name == "top" else Share.as_cut(side.w.size)
                yield TensionForm(f"{law.name} {name}", law, side, share)
        if type(law).tension is Skin.tension or "top" not in on:
            continue
        inner = [rim.plus, *([] if rim.minus is None else [rim.minus]), *(at for at, _ in mirrors)]
        yield HeldForm(f"{law.name} held", law, faces["top"], inner, X)
        if opens:
            yield SpanForm(f"{law.name} across", law, rim, cut, X)
